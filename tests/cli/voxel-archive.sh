# Voxels become an archive, alone, several, and together with surfels; damage is found.
# memory: 64Mi
mkvoxels() { "$PBS_BUILD/tests/mkvoxels" "$@"; }
mkvoxels 512 nw >a.vox
mkvoxels 64 wcf 4 >b.vox
scene s.obj boxes n=2
pbs-gbuffer -q -r 32 s.obj | pbs-sample -q -n 50 -o s.surf
pbs-flatten -o a.pbs a.vox
pbs-flatten <a.vox >piped.pbs
cmp <(tail -c +1025 a.pbs) <(tail -c +1025 piped.pbs) && echo "same through pipes"
pbs-flatten -v -o all.pbs s.surf a.vox b.vox 2>&1 | grep -E 'nodes|surfels|voxel|channels|record|bytes' | grep -v _resident
pbs-flatten -o other.pbs b.vox s.surf
masked 's/^\([^:]*\).*: ok/\1: ok/' pbs-info --check a.vox b.vox a.pbs all.pbs other.pbs
masked 's/standard input/-/' pbs-info --check <a.vox
pbs-info a.pbs | sed -n '1,2p'
pbs-info a.pbs | awk '$2 == "VOXL" { $1 = $7 = ""; print } $2 == "NODE" { n++ } END { print n " nodes" }'
pbs-info --json <b.vox | grep VOXL
pbs-info --nodes b.vox
pbs-info --tree all.pbs | sed 's/  *$//'
echo "--- in the order of the levels"
mkvoxels 1024 "" | pbs-flatten | pbs-info /dev/stdin | awk '$2 == "VOXL" && $4 == 0 { print $3 }' | tr '\n' ' '
echo
echo "--- what is refused"
cp a.pbs bad.pbs
at=$(pbs-info bad.pbs | awk '$2 == "VOXL" { print $1; exit }')
flip bad.pbs $((at + 64 + 64 + 4))
masked 's/byte [0-9]*/byte N/' pbs-info --check bad.pbs
masked 's/byte [0-9]*/byte N/' pbs-flatten -o no.pbs bad.pbs
head -c 100000 a.vox >cut.vox
masked 's/byte [0-9]*/byte N/' pbs-flatten -o no.pbs cut.vox
masked 's/byte [0-9]*/byte N/' pbs-sample -o no.surf a.vox
test -e no.pbs || echo "no half archive"
