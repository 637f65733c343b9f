# Archives whose data is packed hold the same as those without, and are smaller; damage is found.
# memory: 64Mi
[ -e "$PBS_MODULES/zstd.so" ] && [ -e "$PBS_MODULES/meshopt.so" ] || { echo "skip: no codecs here"; exit 0; }
scene s.obj boxes n=2
pbs-gbuffer -q -r 64 s.obj | pbs-sample -q -n 2k -o s.surf
"$PBS_BUILD/tests/mkvoxels" 128 nc >v.vox
for i in $(seq 3000); do echo "$((i % 50)) $((i / 50 % 50)) $((i % 7))"; done >c.xyz
for codec in none zstd meshopt meshopt-zstd; do
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
status pbs-flatten --codec gzip -o no.pbs s.surf
mkdir empty
PBS_MODULES=$PWD/empty masked "s|$PWD|HERE|" pbs-info --check cloud-meshopt.pbs
rm -f nodes.*
