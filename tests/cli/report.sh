# The report: a page with its tables, made on with after it was stopped, and a recommendation that
# keeps its error.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
unset PBS_MEMORY # the module for pictures needs more than a little
scene sphere.obj sphere n=40
"$PBS_TOP/scripts/report" "$PBS_BUILD" out --quick --max-error 0.2 sphere.obj | sed 's/-n [0-9]*/-n N/'
grep -c '<table>' out/report.html
for t in surfels walls voxels pictures; do echo "$t: $(head -1 out/$t.tsv | wc -w) columns, $(sed 1d out/$t.tsv | wc -l) lines"; done
touch -d '2001-01-01' out/cells/*.json
rm out/cells/voxels_64.json
"$PBS_TOP/scripts/report" "$PBS_BUILD" out --quick --max-error 0.2 sphere.obj >again
find out/cells -name '*.json' -newermt 2001-01-02 | sed 's/.*/made again: &/'
grep '^pbs-gbuffer' again | sed 's/surfels.pbs/s.pbs --stats f.json/; s/| pbs-sample/| pbs-sample --stats s.json/' | sh 2>/dev/null
holds "$(stat_of s.json error_largest) <= 0.2" "what is recommended keeps the error"
status "$PBS_TOP/scripts/report" "$PBS_BUILD" out nothing.obj 2>&1 | sed 's,/[^ ]*/,,'
rm -rf out again s.json f.json
