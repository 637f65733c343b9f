# Stiff scenes beside benign twins, through every stage: a line for each figure that is off by more
# than its bound (scripts/extremes has them).
"$PBS_TOP/scripts/extremes" "$PBS_BUILD" --tsv extremes.tsv >said
status=$?
grep '^off' said
echo "status $status, $(sed 1d extremes.tsv | cut -f1 | sort -u | wc -l) scenes, $(sed 1d extremes.tsv | wc -l) lines"
rm -f said extremes.tsv
