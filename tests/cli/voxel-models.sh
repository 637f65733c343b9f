# Laws of voxels on meshes that people made: the area is the same at any resolution, sets contain each
# other, parents hold their children.
# memory: 256Mi
need_models
for m in PLY/Wuson.ply STL/Wuson.stl STL/sphereWithHole.stl OBJ/spider.obj glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb; do
    pbs-import -q --ignore-missing $models/$m -o m.scene || continue
    for r in 40 333; do
        pbs-voxelize -q -r $r m.scene -o m.vox --stats $r.json
        pbs-voxelize -q -r $r --conservative m.scene -o all.vox --stats all.json
        pbs-voxelize -q -r $r --separating m.scene -o six.vox --stats six.json
        holds "$(stat_of six.json voxels) <= $(stat_of $r.json voxels) && $(stat_of $r.json voxels) <= $(stat_of all.json voxels)" \
            "$m at $r: sets contain each other"
        holds "$(stat_of all.json area_kept) > (1 - 1e-8) * $(stat_of all.json area)" "all of the area is in the conservative set"
        pbs-simplify -q m.vox -o m.lod && pbs-info --check m.lod >checked && grep -c ': ok' checked
    done
    holds "($(stat_of 40.json area) - $(stat_of 333.json area)) ^ 2 < (1e-8 * $(stat_of 40.json area)) ^ 2" "the same area at any resolution"
    rm -f ./*.json
done
