# Options: forms, help, what is refused.
for t in pbs-import pbs-gbuffer pbs-sample pbs-flatten pbs-info pbs-compare pbs-export pbs-view; do
    $t --version
    $t --help | head -2
done
status pbs-sample --frobnicate
status pbs-sample -n
status pbs-sample --count=12x
status pbs-sample --count=-5
status pbs-sample -n0
status pbs-sample --normal-weight 1.5
status pbs-sample --method=magic
status pbs-gbuffer -qx
status pbs-gbuffer a.obj b.obj
status pbs-compare a.ppm
status pbs-info -o x
status pbs-view a.pbs
status pbs-import -j 0 a.obj
status pbs-import -m 12 a.obj
