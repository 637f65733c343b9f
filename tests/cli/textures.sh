# Textured scenes: a missing texture is an error, unless it is allowed; colours arrive.
# memory: 400Mi
need_models
[ -e "$PBS_MODULES/image.so" ] || { echo "skip: the module image is not built"; exit 0; }
pbs-gbuffer -r 64 $models/glTF2/BoxTextured-glTF-Binary/BoxTextured.glb -o box.cand
pbs-info box.cand | head -4
cp $models/OBJ/spider.obj $models/OBJ/spider.mtl .
status pbs-import spider.obj -o x.scene
status pbs-import -q --ignore-missing spider.obj -o spider.scene
pbs-info --check spider.scene
