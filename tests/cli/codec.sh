# Archives whose data is packed hold the same as those without, and are smaller; damage is found.
# memory: 64Mi
[ -e "$PBS_MODULES/zstd.so" ] && [ -e "$PBS_MODULES/meshopt.so" ] && [ -e "$PBS_MODULES/draco.so" ] || { echo "skip: no codecs here"; exit 0; }
scene s.obj boxes n=2
pbs-gbuffer -q -r 64 s.obj | pbs-sample -q -n 2k -o s.surf
"$PBS_BUILD/tests/mkvoxels" 128 nc >v.vox
for i in $(seq 3000); do echo "$((i % 50)) $((i / 50 % 50)) $((i % 7))"; done >c.xyz
for codec in none zstd meshopt meshopt-zstd draco; do
    pbs-flatten --codec $codec -o $codec.pbs s.surf v.vox
    pbs-flatten --codec $codec -o cloud-$codec.pbs c.xyz
    masked 's/[0-9]* bytes/N bytes/' pbs-info --check $codec.pbs cloud-$codec.pbs
    pbs-info --nodes $codec.pbs | sed 1,/^stage.*flatten/d >nodes.$codec
    cmp nodes.none nodes.$codec
    # A pipe is unpacked on the way.
    pbs-info --check <$codec.pbs | sed 's/[0-9]* bytes/N bytes/'
    pbs-info $codec.pbs | grep "^stage pbs-flatten"
    pbs-info $codec.pbs | awk -v c=$codec '$2 == "VOXL" && $8 == c { n++ } END { print n + 0 " chunks of voxels are packed" }'
    pbs-info --json $codec.pbs | grep -c '"VOXL".*"codec"'
    holds "$(stat -c %s $codec.pbs) <= $(stat -c %s none.pbs)" "not larger"
    at=$(pbs-info $codec.pbs | awk '$2 == "VOXL" { print $1; exit }')
    flip $codec.pbs $((at + 64 + 200))
    masked 's/byte [0-9]*/byte N/' pbs-info --check $codec.pbs
done
# Meshes, exact and on a lattice: the same triangles whatever packs them.
scene ordered.obj sphere n=24
grep ^v ordered.obj >t.obj
awk '/^f/ { print NR * 7919 % 10007, $0 }' ordered.obj | sort -n | cut -d' ' -f2- >>t.obj
for codec in none zstd meshopt meshopt-zstd draco; do
    pbs-flatten -q --codec $codec --mesh-bits 14 --stats $codec.json -o mesh-$codec.pbs t.obj
    masked 's/[0-9]* bytes/N bytes/' pbs-info --check mesh-$codec.pbs
    pbs-info --nodes mesh-$codec.pbs | sed 1,/^stage.*flatten/d >nodes.$codec
    cmp nodes.none nodes.$codec
    pbs-info mesh-$codec.pbs | awk -v c=$codec '$2 == "MESH" { n++; p += $8 == c } END { print p + 0, "of", n, "meshes are packed so" }'
    grep -o '"mesh_error_bound": [^,}]*' $codec.json
done
pbs-info mesh-draco.pbs | grep -o 'lattice.*' | sort | uniq -c
pbs-info --json mesh-draco.pbs | grep -o '"lattice".*"axis_error": [^}]*' | sort -u
holds "$(stat -c %s mesh-draco.pbs) < $(stat -c %s mesh-meshopt-zstd.pbs)" "Draco makes them smaller"
# Without bits it takes 16; the others leave meshes exact.
pbs-flatten -q --codec draco t.obj -o 16.pbs
pbs-flatten -q --codec zstd t.obj -o exact.pbs
pbs-info 16.pbs | grep -o 'lattice.*' | sort | uniq -c
pbs-info exact.pbs | grep -c lattice
status pbs-flatten --codec draco --mesh-bits 0 t.obj -o no.pbs
status pbs-flatten --mesh-bits 21 t.obj -o no.pbs
at=$(pbs-info mesh-draco.pbs | awk '$2 == "MESH" { print $1; exit }')
flip mesh-draco.pbs $((at + 64 + 200))
masked 's/byte [0-9]*/byte N/' pbs-info --check mesh-draco.pbs
status pbs-flatten --codec gzip -o no.pbs s.surf
mkdir empty
PBS_MODULES=$PWD/empty masked "s|$PWD|HERE|" pbs-info --check cloud-meshopt.pbs
rm -f nodes.*
