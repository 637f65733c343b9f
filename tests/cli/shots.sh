# Pictures: rising with the prefix, the same far from the origin and in any unit.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
scene s.obj sphere n=60
scene far.obj sphere n=60 offset=1e7
scene small.obj sphere n=60 scale=1e-9
scene huge.obj sphere n=60 scale=1e9
for s in s far small huge; do
    pbs-gbuffer -q -n 20k $s.obj | pbs-sample -n 20k | pbs-flatten -o $s.pbs
    pbs-view --width 320 --height 256 --shot $s.pam $s.pbs
done
pbs-view --width 320 --height 256 -q --geometry --shot truth.pam s.obj
for p in 100 500 2000 8000; do pbs-view --width 320 --height 256 --prefix $p --shot p$p.pam s.pbs; done
ssim() { pbs-compare --json "$1" "$2" | sed 's/.*"ssim": \([0-9.e-]*\).*/\1/'; }
hole() { pbs-compare --json "$1" "$2" | sed 's/.*"hole": \([0-9.e-]*\).*/\1/'; }
holds "$(ssim p100.pam truth.pam) < $(ssim p500.pam truth.pam)" "500 surfels are better than 100"
holds "$(ssim p500.pam truth.pam) < $(ssim p2000.pam truth.pam)" "2000 surfels are better than 500"
holds "$(ssim p2000.pam truth.pam) < $(ssim p8000.pam truth.pam)" "8000 surfels are better than 2000"
holds "$(ssim s.pam truth.pam) > 0.95" "the camera's own choice looks like the geometry"
for p in 100 500 2000 8000; do holds "$(hole p$p.pam truth.pam) < 0.001" "no holes with $p"; done
for s in far small huge; do holds "$(ssim $s.pam s.pam) > 0.99" "$s looks the same"; done
