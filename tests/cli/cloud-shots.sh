# Pictures of point clouds: nodes are drawn with what is above them, as deep as the camera needs.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
# A sphere of 30000 points, spread evenly, with 100000 more near its top, and its geometry.
awk 'BEGIN { n = 30000; m = 100000; for (i = 0; i < n + m; i++) {
        y = i < n ? 1 - (2 * i + 1) / n : 1 - 0.01 * (i - n + 0.5) / m
        a = i * 2.39996322972865332
        if (i >= n) a -= 1.5707963267948966 * int(a / 1.5707963267948966)
        r = sqrt(1 - y * y)
        printf "%.9f %.9f %.9f 200 200 200\n", r * cos(a), y, r * sin(a) } }' >s.xyz
awk 'BEGIN { n = 128; pi = 3.14159265358979
    for (i = 0; i <= n; i++) for (j = 0; j < 2 * n; j++) {
        t = pi * i / n; p = pi * j / n
        printf "v %.9f %.9f %.9f\n", sin(t) * cos(p), cos(t), sin(t) * sin(p) }
    for (i = 0; i < n; i++) for (j = 0; j < 2 * n; j++) {
        a = i * 2 * n + 1; b = a + 2 * n; k = (j + 1) % (2 * n)
        print "f", a + j, a + k, b + k, b + j } }' >s.obj
pbs-flatten -q --stats flatten.json -o s.pbs s.xyz
view() { pbs-view -q --width 320 --height 256 --camera 2.5,1.5,2.5,0,0,0 "$@"; }
view --shot truth.pam -g s.obj
view --stats all.json --prefix 1000000 --shot all.pam s.pbs
view --stats some.json --shot some.pam s.pbs
view --stats coarse.json --surfel-size 20 --shot coarse.pam s.pbs
nodes() { stat_of "$1.json" nodes; }
surfels() { stat_of "$1.json" surfels; }
holds "$(surfels all) == $(stat_of flatten.json points)" "a long prefix is every point of every node"
holds "$(surfels coarse) < $(surfels some) && $(surfels some) <= $(surfels all)" "larger discs need fewer"
holds "$(nodes coarse) < $(nodes all)" "and fewer nodes"
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e-]*\).*/\1/'; }
for p in all some coarse; do holds "$(number $p.pam truth.pam hole) < 0.001" "$p: no holes"; done
rm -f ./*.json
