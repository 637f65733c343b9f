# Real files from a Debian package: what is read of them.
# memory: 256Mi
need_models
count() { pbs-import -q "$1" -o x.scene --stats x.json && echo "$(basename "$1"): $(stat_of x.json triangles) triangles, $(stat_of x.json triangles_stored) stored, $(stat_of x.json nodes) nodes"; }
count $models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb
count $models/glTF2/BoxTextured-glTF-Binary/BoxTextured.glb
count $models/glTF2/BoxTextured-glTF-Embedded/BoxTextured.gltf
count $models/PLY/Wuson.ply
count $models/STL/Spider_binary.stl
count $models/STL/Spider_ascii.stl
count $models/OBJ/spider.obj
for f in "$models"/glTF2/IndexOutOfRange/*.gltf "$models"/glTF2/MissingBin/*.gltf "$models"/glTF2/RecursiveNodes/*.gltf; do
    masked "s|$models/||" pbs-import "$f" -o y.scene
done
rm x.scene
ls
