# pbs-voxelize: same bytes for any -j, -m and order of triangles; moves by whole voxels; what is
# refused; numbers.
scene s.obj sphere n=60
status pbs-voxelize -q -r 300 -j 1 s.obj -o a.vox --stats s.json
pbs-info --check a.vox
status pbs-voxelize -q -r 300 -j 3 -m 200M s.obj -o b.vox
cmp a.vox b.vox && echo "same for -j and -m"
holds "$(stat_of s.json voxels) > 200000 && $(stat_of s.json voxels) < 300000" "as many voxels as a sphere has"
holds "$(stat_of s.json area_kept) <= $(stat_of s.json area) && $(stat_of s.json area_kept) > 0.8 * $(stat_of s.json area)" "most of the area is kept"
holds "$(stat_of s.json parts_oriented) == 1 && $(stat_of s.json parts_unoriented) == 0" "a closed sphere is oriented"

# Another order of the triangles; a file of the same name, since the header has it.
mkdir other
{ grep ^v s.obj; grep ^f s.obj | sort -R --random-source=s.obj; } >other/s.obj
pbs-voxelize -q -r 300 other/s.obj -o c.vox
cmp a.vox c.vox && echo "same for any order of triangles"

# Kinds of sets: counts in the right order.
count() { pbs-voxelize -q -r 128 "$@" s.obj --stats c.json -o /dev/null && stat_of c.json voxels; }
thin=$(count) six=$(count --separating) all=$(count --conservative) bare=$(count --bare)
holds "$six == $bare && $six <= $thin && $thin < $all" "sets contain each other"

# A needle thinner than a voxel, and a part smaller than one: gaps without orphans, none with.
cat >needle.obj <<END
v 0 0 0
v 100 37.3 21.7
v 100 37.3 21.700001
v 3.21 90.3 50.2
v 3.22 90.3 50.2
v 3.22 90.31 50.21
f 1 2 3
f 4 5 6
END
count() { pbs-voxelize -q -r 100 "$@" needle.obj --stats c.json -o /dev/null && stat_of c.json voxels; }
thin=$(count) six=$(count --separating)
holds "$thin > $six && $thin >= 100" "needles and small parts are kept"

# What one triangle of two materials leaves on the faces.
status pbs-voxelize -q -r 64 --per-face colour s.obj -o p.vox
pbs-info --check p.vox
status pbs-voxelize -q -r 64 --per-face material --interior --orientation unknown s.obj -o p.vox
pbs-info --check p.vox

# A cube of one's own: the same scene moved by whole voxels has the same voxels.
scene m.obj sphere n=60 offset=8
pbs-voxelize -q -r 512 --box -2,-2,-2,16 s.obj --stats a.json -o m1.vox
pbs-voxelize -q -r 512 --box 6,6,6,16 m.obj --stats b.json -o m2.vox
holds "$(stat_of a.json voxels) == $(stat_of b.json voxels) && $(stat_of a.json fragments) == $(stat_of b.json fragments)" "moved by whole voxels"
status pbs-voxelize -q --box 100,100,100,1 s.obj -o x.vox
status pbs-voxelize --box 1,2,3 s.obj -o x.vox
status pbs-voxelize --box 1,2,3,0 s.obj -o x.vox
status pbs-voxelize --box 1,2,3,4,5 s.obj -o x.vox
status pbs-voxelize --bare --conservative s.obj -o x.vox
status pbs-voxelize --bare --per-face colour s.obj -o x.vox
status pbs-voxelize -r 0 s.obj -o x.vox
status pbs-voxelize -r 65537 s.obj -o x.vox
head -c 3000 a.vox >cut.vox
status pbs-voxelize cut.vox -o x.vox
status pbs-info --check cut.vox
masked 's/[0-9.]*Mi/N/g' pbs-voxelize -m 7M -r 4096 s.obj -o x.vox
ls x.* 2>/dev/null

# Scales, offsets, bad triangles.
for v in scale=1e-9 scale=1e9 offset=1e7 "shear=3 mirror=1"; do
    # shellcheck disable=SC2086
    scene n.obj sphere n=20 $v
    pbs-voxelize -q -r 64 n.obj --stats n.json -o n.vox
    pbs-info --check n.vox | sed 's/: .*//' >/dev/null && echo "$v: $(stat_of n.json parts_oriented) oriented"
done
scene bad.obj bad
status pbs-voxelize -r 64 bad.obj -o n.vox
pbs-info --check n.vox >/dev/null && echo fine

# Measures: the error is that of the resolution.
scene s.obj sphere n=60
pbs-voxelize -q -r 64 --measure s.obj --stats a.json -o a.vox
pbs-voxelize -q -r 128 --measure s.obj --stats b.json -o b.vox
pbs-voxelize -q -r 128 s.obj -o c.vox
cmp b.vox c.vox && echo "measuring changes nothing"
ratio=$(awk "BEGIN { print $(stat_of a.json distance_mean) / $(stat_of b.json distance_mean) }")
holds "$ratio > 1.9 && $ratio < 2.15" "half a voxel, half the distance"
holds "$(stat_of b.json distance_max) <= 0.51 * $(stat_of b.json voxel)" "at most half a voxel on a smooth surface"
holds "$(stat_of b.json normal_mean) < $(stat_of a.json normal_mean)" "normals get better"
