# What the stages cost as inputs grow: exponents within their bounds, the same bytes for any -j and -m.
unset PBS_MEMORY
"$PBS_TOP/scripts/scaling" "$PBS_BUILD" out --quick >said
echo "status $?"
grep '^off' said
for t in size size-exponents threads limit; do echo "$t: $(head -1 out/$t.tsv | wc -w) columns, $(sed 1d out/$t.tsv | wc -l) lines"; done
grep -c '<svg' out/scaling.html

echo "a law that is broken is said, of figures that are there"
touch -d '2001-01-01' out/cells/*.json
"$PBS_TOP/scripts/scaling" "$PBS_BUILD" out --quick --bound 0.1 >said
echo "status $?"
grep -E '^off: size: (gbuffer|sample): cpu' said | sed 's/power [0-9.]*/power N/'
find out/cells -name '*.json' -newermt 2001-01-02
sed -i 's/"sum":"[0-9]/&9/' out/cells/limit_*_flatten_32.json
"$PBS_TOP/scripts/scaling" "$PBS_BUILD" out --quick --bound 9 | grep '^off'
status "$PBS_TOP/scripts/scaling" "$PBS_BUILD" out --most 10 2>&1
rm -rf out said
