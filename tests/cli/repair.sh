# Soups become oriented, closed meshes; good meshes stay as they are.
[ -e "$PBS_MODULES/mend.so" ] || { echo "skip: the module mend is not built"; exit 0; }
# Turns every second face round; its first corner stays the first.
mix() { awk '$1 == "f" && ++n % 2 { printf "f %s", $2; for (i = NF; i > 2; i--) printf " %s", $i; print ""; next } { print }'; }
counts() { for n in "$@"; do printf '%s %s  ' "$n" "$(stat_of r.json "$n")"; done; echo; }
all="parts closed_before closed_after flipped duplicates holes holes_filled"
scene box.obj boxes n=1
mix <box.obj >mixed.obj
echo "== a box"
pbs-import box.obj -o box.scene
pbs-repair box.scene -o fixed.scene --stats r.json
counts $all
diff <(pbs-info box.scene | tail -n +4 | cut -c 13-) <(pbs-info fixed.scene | tail -n +5 | cut -c 13-) && echo "as it was"
echo "== mixed windings, from a pipe"
pbs-repair <mixed.obj -o mixed.scene --stats r.json
counts $all
status pbs-info --check mixed.scene
echo "== a side is missing, a side comes twice"
{ grep -v 'f 1 5 8' mixed.obj && grep 'f 2 3' box.obj; } >open.obj
pbs-repair open.obj --stats r.json -o open.scene
counts $all
pbs-repair open.scene --fill-holes 4 --self-intersections --stats r.json -o filled.scene
counts $all filled_triangles intersections
echo "== parts"
scene parts.obj boxes n=2 parts=1
mix <parts.obj | pbs-repair -o parts.scene --stats r.json
counts $all nodes triangles triangles_stored
echo "== large, and cut afterwards"
scene sphere.obj sphere n=40
mix <sphere.obj | pbs-repair --split 1000 -o sphere.scene --stats r.json
counts $all
echo "== materials and normals"
printf 'newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n' >m.mtl
{ echo "mtllib m.mtl"; awk '$1 == "f" { print "usemtl", (++n % 2 ? "a" : "b") } { print }' mixed.obj; } >paint.obj
pbs-repair paint.obj -o paint.scene --stats r.json
pbs-info paint.scene | awk '$2 ~ /MATL|MESH|NODE/ { print $2, $5 }'
echo "== refused"
status pbs-repair mixed.obj --fill-holes -1 -o x.scene
status pbs-repair nothing.obj -o x.scene
masked 's/[0-9.]*Mi/N/g' pbs-repair -m 17M sphere.obj -o x.scene
PBS_MODULES=$PWD/none masked "s|$PWD|HERE|g" pbs-repair mixed.obj -o x.scene
ls x.* 2>/dev/null
