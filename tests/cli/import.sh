# Huge parts are cut, flat lists grouped; nothing else changes, and -m changes nothing at all.
# memory: 24Mi
scene sphere.obj sphere n=60
pbs-import --split 0 --stats whole.json -o whole.scene sphere.obj
pbs-import --split 2000 --stats cut.json -o cut.scene sphere.obj
for n in triangles triangles_stored parts_split; do echo "$n: $(stat_of whole.json $n) $(stat_of cut.json $n)"; done
pbs-info --nodes cut.scene | awk '/\[/ { print $1, $2, $3, $4 }'
status pbs-info --check cut.scene
scene boxes.obj boxes n=12 parts=1
for group in 0 32; do
    pbs-import --group $group --stats g.json -o boxes$group.scene boxes.obj
    echo "--group $group: $(stat_of g.json nodes) nodes, $(stat_of g.json triangles) triangles, $(stat_of g.json groups) groups"
done
status pbs-info --check boxes32.scene
pbs-import boxes.obj -o default.scene
pbs-import --split 400k --group 32 boxes.obj -o given.scene
diff <(pbs-info --nodes default.scene | tail -n +3) <(pbs-info --nodes given.scene | tail -n +3) && echo "the defaults are these"
status pbs-import --split -1 boxes.obj -o x.scene
# A plant: everything that is placed is stored once.
perl -MJSON::PP -e 1 2>/dev/null || echo "no perl here"
for n in 1 60; do
    "$PBS_TOP/scripts/mkplant" --bin plant$n.bin "$PBS_TOP/testdata/quads.gltf" $n >plant$n.gltf || continue
    if [ -e "$PBS_BUILD/lib/pbs/gltf.so" ]; then
        pbs-import -q --ignore-missing --stats p$n.json -o plant$n.scene plant$n.gltf
        echo "$n placed: $(stat_of p$n.json triangles) triangles, $(stat_of p$n.json triangles_stored) stored"
    fi
done
rm -f x.*
