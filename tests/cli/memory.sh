# A limit that is too small is refused with the number that would do; what is enough is enough.
scene sphere.obj sphere n=40
status pbs-import -m 6M sphere.obj -o x.scene
pbs-gbuffer -q -r 200 sphere.obj -o s.cand
masked 's/[0-9.]*Mi is needed/N is needed/' pbs-gbuffer -m 16M -r 2000 sphere.obj -o x.cand
# More threads than there is memory for are fewer threads, and no error.
for m in 60M 80M 100M; do status pbs-gbuffer -q -m $m -j 8 -r 700 sphere.obj -o /dev/null; done
masked 's/[0-9.]*Mi/N/g' pbs-sample -m 7M s.cand -o x.surf
pbs-sample -m 24M -n 1000 s.cand -o s.surf --stats s.json
holds "$(stat_of s.json memory_counted) <= 24e6" "counted memory is below the limit"
ls x.* 2>/dev/null
