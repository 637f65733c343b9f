# The examples of the man pages run.
cd "$PBS_TOP" || exit 1
engine=/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb
[ -e $engine ] || { echo "skip: the Debian package assimp-testmodels is not installed"; exit 0; }
bad=0
for m in man/*.[157]; do
    dir=$(mktemp -d "$TMPDIR/examples.XXXXXX")
    ln -s $engine "$dir/engine.glb"
    sed -n '/^\.Sh EXAMPLES/,/^\.Sh [^E]/p' "$m" | awk '/^\$ /{ on = 1; sub(/^\$ /, "") } on { print } on && !/\\$/{ on = 0 }' | sed -e 's/\\e/\\/g' -e 's/\\&//g' -e 's/\\-/-/g' >"$dir/commands"
    [ -s "$dir/commands" ] || continue
    out=$(cd "$dir" && bash -e -o pipefail ./commands 2>&1 >/dev/null) || { echo "$m: the examples end with an error:"; echo "$out" | tail -5; bad=1; }
done
exit $bad
