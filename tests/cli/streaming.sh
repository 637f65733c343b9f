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
