# Instances mirrored, sheared, far, tiny and huge in one scene, coincident: as the plain twin.
# memory: 256Mi
[ -e "$PBS_MODULES/gltf.so" ] || { echo "skip: the module gltf is not built"; exit 0; }
candidates() { pbs-gbuffer -q -r 100 "$1" -o "$1.cand" --stats "$1.g" && pbs-sample -q -n 500 "$1.cand" -o "$1.surf"; }
points() { pbs-info "$1.cand" | sed -n 's/.* PNTS *[0-9]*//p'; }
same() { [ -n "$(points "$1")" ] && cmp <(points "$1") <(points "$2") && echo "same points: $3"; }
near() { holds "($2) > (1 - $4) * ($3) && ($2) < (1 + $4) * ($3)" "$1"; }
unit=1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1
# Instances under a matrix, each twice so that the root is more than a wrapper of its part, and boxes whose corners were taken there beforehand.
scene bent.obj boxes n=1 shear=0.5 mirror=1 scale=4
scene bent.gltf placed matrix=-4,0,0,0,-2,4,0,0,0,0,4,0,0,0,0,1 m2=-4,0,0,0,-2,4,0,0,0,0,4,0,0,0,0,1
scene flat.obj boxes n=1 mirror=1 offset=10000000
scene flat.gltf placed matrix=-1,0,0,0,0,1,0,0,0,0,1,0,10000000,10000000,10000000,1 m2=-1,0,0,0,0,1,0,0,0,0,1,0,10000000,10000000,10000000,1
for s in bent.obj bent.gltf flat.obj flat.gltf; do candidates $s; done
same bent.obj bent.gltf "mirrored and sheared"
same flat.obj flat.gltf "mirrored and far"
scene one.gltf placed matrix=$unit
scene two.gltf placed matrix=$unit m2=$unit
scene large.gltf placed matrix=1e9,0,0,0,0,1e9,0,0,0,0,1e9,0,0,0,0,1 m2=1e9,0,0,0,0,1e9,0,0,0,0,1e9,0,0,0,0,1
scene ends.gltf placed matrix=1e9,0,0,0,0,1e9,0,0,0,0,1e9,0,0,0,0,1 m2=1e-9,0,0,0,0,1e-9,0,0,0,0,1e-9,0,1e8,2e8,3e8,1
scene small.gltf placed matrix=1e-9,0,0,0,0,1e-9,0,0,0,0,1e-9,0,0,0,0,1 m2=1e-9,0,0,0,0,1e-9,0,0,0,0,1e-9,0,0,0,0,1
for s in one two large ends small; do candidates $s.gltf; done
same one.gltf two.gltf "twice in one place"
same large.gltf ends.gltf "10^-9 inside of 10^9"
near "small: candidates" "$(stat_of small.gltf.g candidates)" "$(stat_of one.gltf.g candidates)" 0.002
near "small: pixel" "$(stat_of small.gltf.g pixel)" "1e-9 * $(stat_of one.gltf.g pixel)" 1e-6
rm -f ./*.g
