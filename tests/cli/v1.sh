# Files that version 1.0 of the container wrote stay readable, and say the same.
# memory: 256Mi
cp "$PBS_TOP"/testdata/v1/*.pbs .
pbs-info --check scene.pbs candidates.pbs surfels.pbs archive.pbs
for f in scene candidates surfels archive; do pbs-info $f.pbs; pbs-info --nodes $f.pbs | tail -n +5; done
pbs-sample -n 5 candidates.pbs | pbs-flatten | pbs-info --check
pbs-flatten surfels.pbs | pbs-info --check
