# Bad scenes: one line that names file and place, the right status, nothing left behind.
: >empty.obj
mkdir folder
echo "v 0 0 0" >nothing.obj
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 7\n' >range.obj
printf 'v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n' >flat.obj
printf 'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n' >cut.ply
printf 'solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n' >cut.stl
printf 'glTF\2\0\0\0\377\0\0\0' >cut.glb
echo '{"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_unheard_of"]}' >needs.gltf
echo '{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 36, "uri": "gone.bin"}], "bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}' >buffer.gltf
head -c 1000 /dev/zero >zeros.bin
echo "ISO-10303-21;" >part.step
for f in gone.obj empty.obj folder nothing.obj range.obj flat.obj cut.ply cut.stl cut.glb needs.gltf buffer.gltf zeros.bin part.step; do
    status pbs-import $f -o x.scene
    status pbs-gbuffer $f -o x.cand
done
ls
