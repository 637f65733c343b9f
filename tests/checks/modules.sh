# A module whose library is not there is left out of the build, and the others stay.
cd "$PBS_TOP" || exit 1
modules() { make -pnq "$@" 2>/dev/null | sed -n 's/^modules := *//p'; }
[ "$(modules)" = "gltf image exr" ] || { echo "skip: not all modules' libraries are installed"; exit 0; }
[ "$(modules flags_image=-nostdinc)" = "gltf exr" ] || { echo "without OpenImageIO: $(modules flags_image=-nostdinc)"; exit 1; }
[ "$(modules flags_gltf=-nostdinc)" = "image exr" ] || { echo "without tinygltf: $(modules flags_gltf=-nostdinc)"; exit 1; }
