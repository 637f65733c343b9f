# All levels of voxels: through pipes, once and twice, in any order, in little memory, and what is
# not voxels.
make="$PBS_BUILD/tests/test_simplify"
"$make" ball 300 colour other >ball.vox
"$make" ball 300 colour other chunks >chunks.vox
"$make" ball 300 colour other voxels >voxels.vox
"$make" ball 300 colour other chunks voxels >both.vox
status pbs-simplify ball.vox -o ball.lod --stats ball.json
for s in voxels voxels_coarser voxels_coarsest levels nodes nodes_sorted; do echo "$s $(stat_of ball.json $s)"; done
holds "$(stat_of ball.json memory_resident) < 200e6" "less than 200 MB"
pbs-info ball.lod | tail -n 16 | awk '{ print $2, $3, $4, $5 }'

# However it comes: the same chunks, under a header that says whence.
chunks_of() { pbs-info "$1" | awk 'NF == 7 && $2 != "tag" { print $2, $3, $4, $5, $6, $7 }'; }
chunks_of ball.lod >want
pbs-simplify <ball.vox >pipe.lod && chunks_of pipe.lod | cmp - want && echo "a pipe: the same"
pbs-simplify -q chunks.vox -o a.lod && chunks_of a.lod | cmp - want && echo "chunks in no order: the same"
pbs-simplify voxels.vox -o b.lod && chunks_of b.lod | cmp - want && echo "voxels in no order: the same"
pbs-simplify -q both.vox -o c.lod && chunks_of c.lod | cmp - want && echo "both: the same"
pbs-simplify ball.lod -o d.lod && chunks_of d.lod | cmp - want && echo "twice: the same"
pbs-simplify --levels 1 ball.vox | pbs-simplify -o e.lod && chunks_of e.lod | cmp - want && echo "one level, then all: the same"
masked 's/node [0-9]*/node N/' pbs-simplify -o x.lod < <(cat chunks.vox)
masked 's/node [0-9]*/node N/' pbs-simplify chunks.vox -o f.lod

# Which levels.
for o in "--least 1" "--least 100k" "--levels 0" "--levels 1 --least 1"; do
    # shellcheck disable=SC2086
    pbs-simplify $o ball.vox --stats s.json -o s.lod
    echo "$o: $(stat_of s.json levels) levels, $(stat_of s.json nodes) nodes, $(stat_of s.json voxels_coarsest) voxels"
done

# A whole chunk that is full, and what faces look like: what does not fit waits in a file.
"$make" solid 100 faces >solid.vox
status pbs-simplify -m 16M solid.vox -o solid.lod --stats s.json
holds "$(stat_of s.json memory_counted) <= 16e6" "counted memory is below the limit"
pbs-simplify solid.vox | chunks_of - >solid.want
chunks_of solid.lod | cmp - solid.want && echo "in little memory: the same"
masked 's/[0-9.]*Mi/N/g' pbs-simplify -m 7M solid.vox -o x.lod

# What is not voxels, or damaged.
scene boxes.obj boxes n=1
pbs-import boxes.obj -o boxes.scene
status pbs-simplify boxes.scene -o x.lod
status pbs-simplify boxes.obj -o x.lod
status pbs-simplify --least 0 ball.vox -o x.lod
status pbs-simplify --levels 32 ball.vox -o x.lod
head -c 30000 ball.vox >cut.vox
status pbs-simplify cut.vox -o x.lod
masked 's/byte [0-9]*/byte N/' pbs-simplify -o x.lod < <(cat cut.vox)
cp ball.vox flip.vox; flip flip.vox 50000
status pbs-simplify flip.vox -o x.lod
ls x.* 2>/dev/null
