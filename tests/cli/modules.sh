# A module that is not there is named; what needs none goes on.
scene boxes.obj boxes n=1
pbs-gbuffer -r 32 boxes.obj -o boxes.cand
export PBS_MODULES=$PWD/none
mkdir none
pbs-gbuffer -r 32 boxes.obj | pbs-sample -n 50 | pbs-flatten | pbs-info --check
echo '{"asset": {"version": "2.0"}}' >a.gltf
masked "s|$PWD|HERE|g" pbs-import a.gltf -o a.scene
masked "s|$PWD|HERE|g" pbs-gbuffer -q -r 32 --exr out boxes.obj -o b.cand
printf 'not a library' >none/gltf.so
masked "s|$PWD|HERE|g" pbs-import a.gltf -o a.scene
ls
