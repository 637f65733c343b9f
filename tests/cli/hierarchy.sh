# Surfels for every node that the rules name, from geometry or from surfels; what moves; what fails.
# memory: 256Mi
need=36
scene s.obj balls n=$need
pbs-import -q s.obj -o s.scene
draw() { pbs-gbuffer -q -n 1k "$@" s.scene -o x.cand && pbs-sample -q x.cand -o x.surf; }
# How many surfels each node has: "nodes:surfels" for those that have the same number.
counts() { pbs-info "$1" | awk '/ PNTS / { n[$3] += $5 } END { for (i in n) print n[i] }' | sort -n | uniq -c | awk '{ printf "%s:%s ", $1, $2 } END { print "" }'; }
leaves() { pbs-info "$1" | awk -v n=$need '/ PNTS / && $3 < n { print $3, $5, $7 }'; }
echo "the rules"
draw && counts x.surf && cp x.surf up.surf && cp x.cand up.cand
draw --top-down && counts x.surf && mv x.surf down.surf && mv x.cand down.cand
cmp <(leaves up.cand) <(leaves down.cand) && cmp <(leaves up.surf) <(leaves down.surf) && echo "leaves are the same"
bytes() { stat -c %s "$1"; }
holds "$(bytes up.cand) < $(bytes down.cand)" "fewer candidates bottom-up"
pbs-info --check up.cand up.surf down.surf
draw --least 1G && counts x.surf
draw --least 1561 && counts x.surf
draw --share 0.1 && counts x.surf
draw --share 0 && counts x.surf
pbs-sample -q -n 100 up.cand -o few.surf && counts few.surf
# In a pipe, and from the scene file itself.
pbs-gbuffer -q -n 1k s.obj | pbs-sample | cmp <(tail -c 100000 up.surf) <(tail -c 100000) && echo "same in a pipe"
rm -f x.cand down.cand few.surf

echo "what fails"
status pbs-gbuffer -q -m 100Mi -n 3M --share 0.2 s.scene -o all.cand 2>&1 | sed 's/at least.*/at least/'
status pbs-gbuffer --keep-going -m 100Mi -n 3M --share 0.2 s.scene -o some.cand 2>&1 | sed 's/at least.*/at least/'
pbs-sample -q some.cand -o some.surf && counts some.surf
pbs-info --check some.cand some.surf
rm -f some.cand some.surf

for m in gltf image; do [ -e "$PBS_MODULES/$m.so" ] || { echo "skip: the module $m is not built"; exit 0; }; done
printf 'newmtl broken\nKd 1 0.5 0\nmap_Kd broken.png\n' >t.mtl
echo "no picture" >broken.png
{ echo "mtllib t.mtl"; echo "usemtl broken"; printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 2/1 3/2 4/3\n'; } >t.obj
status pbs-gbuffer -q -n 100 t.obj -o t.cand
status pbs-gbuffer -n 100 --keep-going t.obj -o t.cand
pbs-info --check t.cand
echo "what moves"
# Two boxes that stand and one that moves.
at() { echo "1,0,0,0,0,1,0,0,0,0,1,0,$1,0,0,1"; }
scene two.gltf placed matrix="$(at 0)" m2="$(at 9)"
sed "1s/\[0, 1\]/[0, 1, 2]/; 2s/],\$/, {\"mesh\": 0, \"matrix\": [$(at -2)]}],/" two.gltf >three.gltf
sed '2a "animations": [{"channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}], "samplers": [{"input": 0, "output": 0}]}],' three.gltf >moving.gltf
for s in three moving; do
    pbs-gbuffer -q -n 1k $s.gltf -o $s.cand --stats $s.g
    pbs-sample -q $s.cand | pbs-flatten -o $s.pbs
    counts $s.pbs
    pbs-info --check $s.pbs
done
holds "$(stat_of moving.g pixel) < 0.5 * $(stat_of three.g pixel)" "its place is not in the root's picture"
pbs-info --tree moving.pbs | sed "1,/records  name/d"
pbs-info --tree --json moving.pbs | grep -c "\"moves\": true"
# The picture is of all three.
text=$(pbs-view -q --width 320 --height 128 --geometry --shot truth.pam moving.gltf 2>&1)
case "$text" in
*libEGL* | *"OpenGL: no device"*) ssim=1 hole=0 ;;
*)
    pbs-view --width 320 --height 128 --shot moving.pam moving.pbs
    numbers=$(pbs-compare --json moving.pam truth.pam)
    ssim=$(sed 's/.*"ssim": \([0-9.e-]*\).*/\1/' <<<"$numbers")
    hole=$(sed 's/.*"hole": \([0-9.e-]*\).*/\1/' <<<"$numbers")
    ;;
esac
holds "$hole < 0.01 && $ssim > 0.9" "all three are seen"
rm -f ./*.g ./*.pam
