# Several streams become one archive with a root; channels that one of them lacks are filled.
scene a.obj boxes n=2
printf 'newmtl red\nKd 1 0 0\n' >b.mtl
{ echo "mtllib b.mtl"; echo "usemtl red"; "$PBS_TOP/scripts/mkscene" sphere n=12 offset=5; } >b.obj
for s in a b; do pbs-gbuffer -q -r 100 $s.obj | pbs-sample -n 400 -o $s.surf; done
pbs-flatten a.surf b.surf -o ab.pbs
pbs-info ab.pbs | sed 's/[0-9a-f]\{8\}$//'
pbs-info --nodes ab.pbs | cut -c1-40
pbs-info --check ab.pbs
