# Deferred splatting and points in one pass: the same picture as discs and as the cut, with less.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
scene s.obj sphere n=60
pbs-gbuffer -q -n 20k s.obj | pbs-sample -n 20k | pbs-flatten -o s.pbs
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e-]*\).*/\1/'; }
view() { pbs-view -q --width 320 --height 256 "$@"; }
view --shot truth.pam -g s.obj
view --shot off.pam s.pbs
for m in on afresh whole; do
    view --splat $m --stats $m.json --shot $m.pam s.pbs
    holds "$(number $m.pam truth.pam ssim) > $(number off.pam truth.pam ssim) - 0.005" "$m: as good as discs"
    holds "$(number $m.pam truth.pam hole) < 0.001" "$m: no holes"
    holds "$(number $m.pam on.pam ssim) > 0.99" "$m: the same picture"
done
holds "$(stat_of on.json visible) < 0.7 * $(stat_of on.json surfels)" "what is behind is not blended"
holds "$(stat_of whole.json visible) == 0 + $(stat_of whole.json surfels)" "without selection all are"
# What was drawn before, here the geometry, does not show.
view --splat on --bench b.tsv --frames 3 --truth s.obj s.pbs
holds "$(awk -F'\t' '/^#max/ { print $15 }' b.tsv) < 0.001" "a series: no holes"
rm b.tsv
# A sphere of 30000 points, spread evenly.
awk 'BEGIN { n = 30000; for (i = 0; i < n; i++) {
        y = 1 - (2 * i + 1) / n; a = i * 2.39996322972865332; r = sqrt(1 - y * y)
        printf "%.9f %.9f %.9f 200 200 200\n", r * cos(a), y, r * sin(a) } }' >c.xyz
pbs-flatten -q -o c.pbs c.xyz
for m in cut reduce periphery cast; do
    view --points $m --stats $m.json --surfel-size 4 --camera 2.5,1.5,2.5,0,0,0 --shot $m.pam c.pbs
done
for m in reduce periphery cast; do
    holds "$(number $m.pam cut.pam ssim) > 0.8" "$m: like the cut"
    holds "$(number $m.pam cut.pam hole) < 0.005" "$m: no holes"
done
surfels() { stat_of $1.json surfels; }
holds "$(surfels reduce) > 1000 && $(surfels reduce) < 30000" "some points are taken"
holds "$(surfels cast) == $(surfels reduce)" "the same without the rasteriser"
holds "$(surfels periphery) < $(surfels reduce)" "fewer in the periphery"
status view --splat often --shot x.pam s.pbs
status view --points all --shot x.pam s.pbs
# Sums are rounded in an order that is free: the last bit of a colour may differ.
rm -f ./*.json ./*.pam
