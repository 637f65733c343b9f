# Pictures of voxels: like the geometry, without holes, at the level that the camera needs, from an
# archive as from the stream, and together with surfels.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
"$PBS_BUILD/tests/mkvoxels" 512 nw >s.vox
"$PBS_BUILD/tests/mkvoxels" 64 nw >plain.vox
# The sphere that they are of.
awk 'BEGIN { n = 128; pi = 3.14159265358979
    for (i = 0; i <= n; i++) for (j = 0; j < 2 * n; j++) {
        t = pi * i / n; p = pi * j / n
        printf "v %.9f %.9f %.9f\n", 0.96 * sin(t) * cos(p), 0.96 * cos(t), 0.96 * sin(t) * sin(p) }
    for (i = 0; i < n; i++) for (j = 0; j < 2 * n; j++) {
        a = i * 2 * n + 1; b = a + 2 * n; k = (j + 1) % (2 * n)
        print "f", a + j, a + k, b + k, b + j } }' >s.obj
pbs-flatten -o s.pbs s.vox
view() { pbs-view -q --width 320 --height 256 --camera 2.5,1.5,2.5,0,0,0 "$@"; }
view --shot truth.pam -g s.obj
view --stats archive.json --shot archive.pam s.pbs
view --shot stream.pam s.vox
view --stats fine.json --surfel-size 0.5 --shot fine.pam s.pbs
view --stats plain.json --shot plain.pam plain.vox
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e-]*\).*/\1/'; }
holds "$(number archive.pam truth.pam ssim) > 0.95" "looks like the geometry"
holds "$(number fine.pam truth.pam ssim) > 0.97" "more so with finer voxels"
for p in archive fine plain; do
    holds "$(number $p.pam truth.pam hole) == 0" "$p: no holes"
done
cmp archive.pam stream.pam && echo "the stream shows the same"
for p in archive fine plain; do echo "$p: $(stat_of $p.json nodes) nodes, $(stat_of $p.json voxels) voxels"; done
echo "--- near the surface, in line with the borders of chunks"
for e in 0,0,1.1,0,0,0 1.1,0.01,0.01,0.3,0.9,0; do
    view --camera $e,0,1,0,60 --shot near.pam s.pbs
    view --camera $e,0,1,0,60 --shot near-truth.pam -g s.obj
    holds "$(number near.pam near-truth.pam hole) < 0.0005" "$e: no holes"
done
echo "--- with surfels"
scene far.obj sphere n=40 offset=3
pbs-gbuffer -q -n 2k far.obj | pbs-sample -q -n 2k -o far.surf
pbs-flatten -o both.pbs far.surf s.vox
pbs-view -q --width 320 --height 256 --stats both.json --shot both.pam both.pbs
echo "$(stat_of both.json nodes) nodes, $(stat_of both.json voxels) voxels"
holds "$(stat_of both.json surfels) > 500" "and surfels"
echo "--- colours of single faces: a sheet that is red below and green above"
printf 'newmtl r\nKd 1 0 0\nnewmtl g\nKd 0 0.5 0\n' >two.mtl
printf 'mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0.01\nv 1 0 0.01\nv 1 1 0.01\nv 0 1 0.01\nusemtl r\nf 1 4 3 2\nusemtl g\nf 5 6 7 8\n' >two.obj
for what in colour material; do
    pbs-voxelize -q -r 16 --orientation trust --per-face $what two.obj | pbs-flatten -q -o two.pbs
    for eye in above:0.5,0.4,2 below:0.5,0.4,-2; do
        view --camera "${eye#*:},0.5,0.5,0,0,1,0,30" --shot sheet.ppm two.pbs
        # The picture's middle.
        tail -c +$((16 + 3 * (128 * 320 + 160))) sheet.ppm | head -c 3 | od -An -tu1 |
            awk -v from="$what, ${eye%:*}" '{ print from ": " (($1 > 2 * $2) ? "red" : ($2 > 2 * $1) ? "green" : "both") }'
    done
done
