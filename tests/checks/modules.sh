# A module whose library is not there is left out of the build, and the others stay.
cd "$PBS_TOP" || exit 1
modules() { make -pnq "$@" 2>/dev/null | sed -n 's/^modules := *//p'; }
[ "$(modules)" = "gltf image exr mend zstd meshopt draco" ] || { echo "skip: not all modules' libraries are installed"; exit 0; }
for m in gltf image exr mend zstd meshopt draco; do
    left=$(echo gltf image exr mend zstd meshopt draco | sed "s/ *$m//; s/^ *//")
    [ "$(modules flags_$m=-nostdinc)" = "$left" ] || { echo "without that of $m: $(modules flags_$m=-nostdinc)"; exit 1; }
done
