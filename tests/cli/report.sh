# The report: a page with its tables, made on with after it was stopped; figures that are those of
# --stats; and a recommendation that works when it is copied, and keeps its error.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
unset PBS_MEMORY # the module for pictures needs more than a little
mkdir "it's here"
scene "it's here/sphere.obj" sphere n=40
# Without the programs in the path, so that the commands at the end say where they are.
report() { PATH=/usr/bin:/bin "$PBS_TOP/scripts/report" "$PBS_BUILD" out --quick --max-error 0.2 "it's here/sphere.obj"; }
report | sed "s/-n [0-9]*/-n N/; s|'/.*here|'HERE|; s|'/.*/bin'|'BIN'|"
grep -c '<table>' out/report.html
for t in out/*.tsv; do echo "$(basename "$t"): $(head -1 "$t" | wc -w) columns, $(sed 1d "$t" | wc -l) lines"; done
for p in out/*.svg; do grep -q '</svg>' "$p" && basename "$p"; done | tr '\n' ' '
echo
# All that is crossed or dotted is drawn by its name, which must be there, once.
grep -oE "href='#[a-z_A-Z0-9-]+'" out/report.html | sort -u | sed "s/.*#\(.*\)'/\1/" >used
holds "$(wc -l <used) > 10 && $(while read -r id; do grep -oE "id=['\"]$id['\"]" out/report.html | wc -l; done <used | grep -vcx 1) == 0" "marks"

echo "made on with"
touch -d '2001-01-01' out/cells/*.json
rm out/cells/voxels_64.json
report >again
find out/cells -name '*.json' -newermt 2001-01-02 | sed 's/.*/made again: &/'

echo "the figures of --stats"
# Columns of the line of a table (its first column is VALUE) that are measures of a program, against
# a run of it: agrees TABLE VALUE FILE.json
agrees() {
    perl -MJSON::PP -e '
        my ($table, $value, $file) = @ARGV;
        sub slurp { open my $f, "<", $_[0] or die; local $/; <$f> }
        my $is = decode_json(slurp($file));
        my ($head, @lines) = map { [split /\t/] } split /\n/, slurp("out/$table.tsv");
        my ($line) = grep { $_->[0] eq $value } @lines or die "no line $value\n";
        my ($n, @off);
        for my $i (0 .. $#$head) {
            my $name = $head->[$i];
            next if !exists $is->{$name} || $name =~ /seconds|memory/;
            $n++;
            push @off, "$name $line->[$i] is $is->{$name}" if abs($line->[$i] - $is->{$name}) > 1e-9 * abs $is->{$name};
        }
        print "$table $value: $n measures", map({ ", $_" } @off), "\n"' "$@"
}
s="it's here/sphere.obj"
pbs-import -q --ignore-missing "$s" -o scene
pbs-gbuffer -q -n 500 scene -o cand
pbs-sample -q -n 500 cand -o surf --stats s.json
agrees surfels "-n 500" s.json
pbs-sample -q -n 500 cand -o surf --measure m.tsv
holds "$(tail -1 m.tsv | cut -f9) == $(awk -F'\t' '$1 == 1 { print $3 }' out/walls.tsv)" "holes"
pbs-voxelize -q -r 64 scene -o vox --measure --stats v.json
# The bytes of the report's table are those of the archive.
pbs-voxelize -q -r 64 scene -o vox
pbs-simplify -q vox -o lod
pbs-flatten -q lod -o vox.pbs --stats f.json
perl -pi -e "s/\"bytes\": \d+/\"bytes\": $(stat_of f.json bytes)/" v.json
agrees voxels 64 v.json
pbs-gbuffer -q -n 2000 scene | pbs-sample -q -n 2000 -o surfels
pbs-flatten -q --codec none surfels -o surf.pbs --stats f.json
agrees packing surfels f.json
pbs-flatten -q surfels -o surf.pbs --stats f.json
agrees quantisation "16 bits in each node" f.json

echo "the recommendation"
grep -v '^report' again >commands
mkdir elsewhere
(cd elsewhere && env PATH=/usr/bin:/bin bash -e ../commands 2>/dev/null)
pbs-info --check elsewhere/surfels.pbs elsewhere/voxels.pbs | sed 's/: [0-9].*//'
sed 's/| pbs-sample/| pbs-sample --stats s.json/; s/pbs-voxelize/pbs-voxelize --stats v.json/' commands | bash 2>/dev/null
holds "$(stat_of s.json error_largest) <= 0.2 && $(stat_of v.json error_bound) <= 0.2" "what is recommended keeps the error"
status "$PBS_TOP/scripts/report" "$PBS_BUILD" out nothing.obj 2>&1 | sed 's,/[^ ]*/,,'
rm -rf out again used commands elsewhere ./*.json m.tsv scene surfels.pbs voxels.pbs cand surf surfels vox lod vox.pbs surf.pbs
