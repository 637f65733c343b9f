# What cannot become a triangle is counted and reported, once, and the rest goes on.
scene bad.obj bad
pbs-import bad.obj -o bad.scene --stats bad.json
echo "triangles $(stat_of bad.json triangles) nonfinite $(stat_of bad.json skipped_nonfinite) degenerate $(stat_of bad.json skipped_degenerate)"
pbs-gbuffer -r 64 bad.scene -o bad.cand
pbs-import -q bad.obj | pbs-info --check
