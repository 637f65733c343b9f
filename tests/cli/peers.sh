# Beside other tools, tiny: what is not installed is said and left out; our own rows keep what
# their pages promise; the measures are right where the answer is known.
need_gl
unset PBS_MEMORY
case "$PBS_BUILD" in *asan | *tsan) echo "skip: the other libraries are not sanitized"; exit 0 ;; esac
command -v c++ >/dev/null && [ -e /usr/include/meshoptimizer.h ] ||
    { echo "skip: no package to compare with is installed (scripts/deps --peers)"; exit 0; }

# Of all packages only the smallest is there, so that the rows are the same everywhere.
mkdir fake
printf '#!/bin/sh\ncase "$*" in *libmeshoptimizer-dev*) printf installed ;; esac\n' >fake/dpkg-query
chmod +x fake/dpkg-query
PATH=$PWD/fake:$PATH "$PBS_TOP/scripts/peers" "$PBS_BUILD" --quick --tsv t.tsv >said 2>/dev/null
echo "status $?"
grep '^skipped' said
echo "$(grep -c '^# ' t.tsv) captions, $(grep -c '^pbs\|^`pbs\|	pbs' t.tsv) rows of ours"
value() { # TABLE ROW COLUMN: of the table whose first words are these
    awk -F'\t' -v table="$1" -v row="$2" -v column="$3" '
        /^# / { here = index($0, table); head = 0; next }
        here && !head { for (i = 1; i <= NF; i++) if ($i == column) c = i; head = 1; next }
        here { for (i = 1; i <= 4; i++) if ($i == row) { print $c; exit } }' t.tsv
}
surface='candidates that views'
holds "$(value "$surface" '`pbs-sample -w 0`' points) == 500" "as many points as wanted"
holds "$(value "$surface" '`pbs-sample -w 0`' 'least spacing') >= $(value "$surface" '`pbs-sample -w 0`' 'covering radius')" "greedy: no two are nearer than the covering radius"
holds "$(value "$surface" '`pbs-sample -w 0`' 'off the surface') == 0" "on the surface"
holds "$(value "$surface" '`pbs-sample`' 'wrong side %') < $(value "$surface" '`pbs-sample -w 0`' 'wrong side %')" "normals help at walls"
holds "$(value "$surface" 'meshoptimizer `simplifyPoints`' 'covering radius') > $(value "$surface" '`pbs-sample -w 0`' 'covering radius')" "nobody is better than greedy by half"
holds "$(value 'bumpy sphere' '`pbs-gbuffer | pbs-sample -w 0`' 'covering radius') < 90" "a mesh is covered"
holds "$(value Voxels '`pbs-voxelize --bare`' gaps) == 0 && $(value Voxels '`pbs-voxelize`' gaps) == 0" "no gaps"
holds "$(value Voxels '`pbs-voxelize --conservative`' missed) == 0 && $(value Voxels '`pbs-voxelize --conservative`' extra) == 0" "conservative"
holds "$(value Voxels '`pbs-voxelize --conservative`' largest) <= 0.867" "at most half a diagonal"
holds "$(value Levels 'all triangles' SSIM) == 1 && $(value Levels 'pbs, surfels' SSIM) > 0.5 && $(value Levels 'pbs, voxels' SSIM) > 0.5" "pictures"
holds "$(value cloud '`pbs-flatten`' 'least distance') >= 0.9999 && $(value cloud '`pbs-flatten`' 'off the input') == 0" "levels of a cloud keep their distance"

echo "measures"
ply() { # TO "X Y Z"...: points
    perl -e 'my $to = shift; open my $f, ">:raw", $to; print $f "ply\nformat binary_little_endian 1.0\nelement vertex ", scalar @ARGV, "\nproperty float x\nproperty float y\nproperty float z\nend_header\n", map { pack "f<3", split } @ARGV' "$@"
}
measure=$PBS_BUILD/peers/measure
ply four.ply "0 0 0" "4 0 0" "4 3 0" "0 3 0"
ply two.ply "0 0 0" "4 3 1"
"$measure" points four.ply two.ply
ply a.ply "0.5 0.5 0.5" "1.5 0.5 0.5" "1.6 0.5 0.5" "5.5 0.5 0.5"
ply b.ply "0.5 0.5 0.5" "2.5 0.5 0.5"
ply c.ply "0.5 0.5 0.5" "1.5 0.5 0.5" "2.5 0.5 0.5" "3.5 0.5 0.5"
"$measure" cells 0 0 0 1 a.ply b.ply c.ply
scene one.obj triangle
"$PBS_BUILD/peers/scene" one.obj one.ply
"$measure" box one.ply
ply above.ply "0 0 0" "0 0 7"
"$measure" surface one.ply above.ply
printf '0 0\n' >cost
"$PBS_BUILD/peers/spend" 1 cost sh -c 'while :; do :; done'
echo "given up: status $?"
rm -rf fake said t.tsv ./*.ply one.obj cost
