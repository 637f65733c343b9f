# Archives that are loaded while they are shown: limits, damage, and pictures that do not depend on
# the order in which things come.
# memory: 512Mi
need_gl
"$PBS_BUILD/tests/mkvoxels" 512 nw >s.vox
pbs-flatten -o s.pbs s.vox
view() { pbs-view -q --width 320 --height 256 --camera 2.5,1.5,2.5,0,0,0 "$@"; }
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e-]*\).*/\1/'; }
view --surfel-size 0.5 --stats all.json --shot all.pam s.pbs
echo "all: $(stat_of all.json nodes) nodes, $(stat_of all.json missing) missing"
view --surfel-size 0.5 --upload 100Ki --shot slow.pam s.pbs && cmp all.pam slow.pam && echo "uploads that are small change nothing"
view --surfel-size 0.5 --partial --no-occlusion --shot same.pam s.pbs && cmp all.pam same.pam && echo "nor does the policy when all is there"
echo "--- little memory"
view --surfel-size 0.5 --gpu-memory 4Mi --stats few.json --shot few.pam s.pbs
holds "$(stat_of few.json nodes) < $(stat_of all.json nodes)" "fewer nodes"
holds "$(stat_of few.json resident_bytes) <= 4194304" "within the limit"
holds "$(number few.pam all.pam hole) == 0" "no holes"
echo "--- small buffers: nodes are divided, and nothing else changes"
{ echo "mtllib c.mtl"; "$PBS_TOP/scripts/mkscene" sphere n=40 | awk '/^f/ { print (NR % 2 ? "usemtl red" : "usemtl green") } { print }'; } >c.obj
printf 'newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 1 0\n' >c.mtl
pbs-gbuffer -q -n 8k c.obj | pbs-sample -q -n 8k | pbs-flatten -q -o octaves.pbs
pbs-voxelize -q -r 60 --per-face material c.obj | pbs-flatten -q -o faces.pbs
awk 'BEGIN { n = 8000; for (i = 0; i < n; i++) {
        y = 1 - (2 * i + 1) / n; a = i * 2.39996322972865332; r = sqrt(1 - y * y)
        printf "%.9f %.9f %.9f 200 200 200\n", r * cos(a), y, r * sin(a) } }' >c.xyz
pbs-flatten -q -o cloud.pbs c.xyz
divided() { # BUFFER FILE OPTION...
    local buffer=$1 file=$2
    shift 2
    view "$@" --shot one.pam "$file"
    view "$@" --buffer "$buffer" --shot many.pam "$file"
}
divided 20Ki octaves.pbs --surfel-size 4 --per-point && cmp one.pam many.pam && echo "surfels: the same"
divided 20Ki octaves.pbs --surfel-size 12 && cmp one.pam many.pam && echo "octaves: the same"
# Sums are rounded in an order that is free.
divided 20Ki octaves.pbs --surfel-size 4 --splat on && holds "$(number one.pam many.pam ssim) > 0.9999" "splats: the same"
divided 16Ki cloud.pbs --points reduce && cmp one.pam many.pam && echo "points: the same"
divided 100Ki faces.pbs && cmp one.pam many.pam && echo "faces: the same"
rm -f one.pam many.pam
echo "--- a damaged chunk"
at=$(pbs-info s.pbs | awk '/ VOXL / { n++; if (n == 3) print $1 }')
cp s.pbs bad.pbs
flip bad.pbs $((at + 4096))
status pbs-view --width 320 --height 256 --camera 2.5,1.5,2.5,0,0,0 --surfel-size 0.5 --shot bad.pam bad.pbs
holds "$(number bad.pam all.pam hole) == 0" "what is coarser stays in its place"
echo "--- every surfel for itself"
scene long.obj sphere n=60
pbs-gbuffer -q -n 20k long.obj | pbs-sample -q -n 20k | pbs-flatten -o long.pbs
near="--camera 0,1.3,0,0.3,1,0,0,1,0,90"
view $near --surfel-size 8 --shot node.pam long.pbs
view $near --surfel-size 8 --per-point --shot point.pam long.pbs
holds "$(number point.pam node.pam hole) < 0.002" "no holes"
cmp -s node.pam point.pam || echo "another picture"
view $near --formula --stats formula.json --shot formula.pam long.pbs
holds "$(stat_of formula.json surfels) > 100" "by the paper's formula"
rm -f ./*.json
