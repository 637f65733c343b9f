# memory: 2Gi
# --keep-going: what cannot be read is left out and named, the rest is as without it, status 65.
[ -e "$PBS_MODULES/gltf.so" ] || { echo "skip: the module gltf is not built"; exit 0; }
one=1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1
two=1,0,0,0,0,1,0,0,0,0,1,0,3,0,0,1
scene good.gltf placed matrix=$one
scene both.gltf placed matrix=$one m2=$two
# A second mesh whose indices reach beyond their buffer, placed beside the good one.
sed 's/, {"mesh": 0,/, {"mesh": 1, "name": "lid",/
     s/"meshes": \[\(.*\)\],$/"meshes": [\1, {"name": "broken", "primitives": [{"attributes": {"POSITION": 0}, "indices": 2}]}],/
     s/"type": "SCALAR"}\],/"type": "SCALAR"}, {"bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR"}],/' both.gltf >bad.gltf
echo "== without it: an error, and nothing is left"
status pbs-import bad.gltf -o bad.scene --stats bad.json
status pbs-gbuffer -r 32 bad.gltf -o bad.cand
ls
echo "== with it"
status pbs-import --keep-going bad.gltf -o bad.scene --stats bad.json
echo "triangles $(stat_of bad.json triangles) failed $(stat_of bad.json skipped_failed) left out $(stat_of bad.json left_out)"
pbs-info --check bad.scene
status pbs-gbuffer -r 32 --keep-going bad.gltf -o bad.cand --stats cand.json
echo "left out $(stat_of cand.json left_out) candidates: $(stat_of cand.json candidates)"
echo "== a scene that was written so is no error"
status pbs-gbuffer -r 32 bad.scene -o second.cand
echo "== what is there is as in a file without the rest"
pbs-gbuffer -q -r 32 good.gltf -o good.cand
for f in good bad second; do pbs-info $f.cand | awk '/PNTS/ { print $2, $NF }' >$f.crc; done
[ -s good.crc ] && cut -d' ' -f2 good.crc | cmp - <(cut -d' ' -f2 bad.crc) && cmp bad.crc second.crc && echo same
echo "== all stages together: an archive of the rest, each note once"
status pbs-build --count 500 --keep-going bad.gltf -o bad.pbs
pbs-build --count 500 bad.scene -o rest.pbs
for f in bad rest; do pbs-info $f.pbs | awk '/PNTS/ { print $2, $NF }' >$f.crc; done
[ -s bad.crc ] && cmp bad.crc rest.crc && echo same
# A root without a name has its file's, also behind a pipe.
pbs-info --json --nodes bad.pbs | grep -o '"name": "bad[^"]*"'
pbs-import -q --split 5000 --keep-going bad.gltf 2>/dev/null | pbs-gbuffer -q -n 100 | pbs-info --json --nodes - | grep -o '"name": "bad[^"]*"'
status pbs-build -m 1Mi --keep-going bad.gltf -o none.pbs 2>/dev/null
echo "== pictures that are not there, and that are none"
cat >square.obj <<X
mtllib square.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl a
f 1/1 2/2 3/3
usemtl b
f 1/1 3/3 4/4
X
printf 'newmtl a\nmap_Kd gone.ppm\nnewmtl b\nmap_Kd half.ppm\n' >square.mtl
printf 'P6 4 4 255\nabc' >half.ppm
status pbs-import square.obj -o x.scene
status pbs-import --keep-going square.obj -o square.scene
status pbs-gbuffer -r 16 square.scene -o x.cand
status pbs-gbuffer -r 16 --keep-going square.scene -o square.cand --stats square.json
echo "left out $(stat_of square.json left_out)"
status pbs-gbuffer -r 16 --keep-going square.obj -o square2.cand
echo "== everything is wrong"
sed 's/"byteLength": 168/"byteLength": 169/' good.gltf >worse.gltf
status pbs-import --keep-going worse.gltf -o worse.scene
ls
