# An error that is asked for is kept, by no more than it takes.
scene sphere.obj sphere n=60
for e in 0.4 0.1 0.03; do
    pbs-gbuffer -q -e $e sphere.obj -o s.cand
    pbs-sample -q -e $e s.cand -o s.surf --stats s.json
    pbs-sample -q -n 100k s.cand -o all.surf --stats all.json
    holds "$(stat_of s.json error_largest) <= $e" "surfels: $e is kept"
    n=$(stat_of s.json surfels)
    pbs-sample -q -n $((n - 1)) s.cand -o less.surf --stats less.json
    holds "$(stat_of less.json error_largest) > $e" "one surfel less: it is not"
    pbs-voxelize -q -e $e --measure sphere.obj -o s.vox --stats v.json
    holds "$(stat_of v.json distance_max) <= $(stat_of v.json error_bound) && $(stat_of v.json error_bound) <= $e" \
        "voxels: $e is kept"
    pbs-voxelize -q -r $(($(stat_of v.json resolution) - 1)) sphere.obj -o s.vox --stats v.json
    holds "$(stat_of v.json error_bound) > $e" "one voxel less along the axes: it is not"
done
status pbs-sample -e 1e-4 s.cand -o s.surf 2>&1 | sed 's/[0-9.]*:/N:/'
status pbs-sample --method paper -e 1 s.cand -o s.surf
status pbs-voxelize -e 1e-9 sphere.obj -o s.vox 2>&1 | sed 's/of up to .*/of up to N/'
status pbs-voxelize -e 1 -r 10 sphere.obj -o s.vox
status pbs-voxelize -e 0.5 -b 0,0,0,100 sphere.obj -o s.vox --stats v.json
stat_of v.json resolution
