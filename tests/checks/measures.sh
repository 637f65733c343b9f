# Every measure of --stats is explained on its program's page, or in pbs.7 if all programs have it;
# and no page explains what its program does not have.
cd "$PBS_TOP" || exit 1
bad=0
literals() { grep -ohE '(pbs_stat_count|pbs_stat_real|stat_median)\([^"]*"[a-z_0-9]+"' "$@" | grep -oE '"[a-z_0-9]+"' | tr -d '"'; }
sources() { # of a program's own measures
    if [ "$1" = pbs-view ]; then find cmd/pbs-view -name '*.c'; else echo "cmd/$1.c"; fi
}
of_program() { # PROGRAM
    local files
    files=$(sources "$1")
    # shellcheck disable=SC2086
    {
        literals $files
        if grep -q 'pbs_stat_record(' $files; then printf '%s\n' channels record_bytes; fi
        if grep -q 'pbs_note_skips(' $files; then echo skipped_...; fi
        if grep -q 'pbs_failures_end(' $files; then echo left_out; fi
        if grep -q 'pbs_mend_count_name' $files; then sed -n '/pbs_mend_count_name\[/,/;/p' formats/scene/mend.c | grep -oE '"[a-z_]+"' | tr -d '"'; fi
    } | sort -u
}
of_page() { # PAGE SECTION
    awk -v section="$2" '/^\.S[sh] /{ on = $0 ~ "^.S[sh] " section "$" } on && /^\.It Li /{ sub(/^\.It Li /, ""); gsub(/ ,/, ""); gsub(/ /, "\n"); print }' "$1" | sort -u
}
compare() { # WHAT
    diff "$TMPDIR/made" "$TMPDIR/told" >"$TMPDIR/diff" || { echo "$1: measures that are written (<) and explained (>):"; cat "$TMPDIR/diff"; bad=1; }
}
programs=0
for p in "$PBS_BUILD"/bin/pbs-*; do
    name=$(basename "$p")
    # pbs-build has those of its stages, and pbs-compare explains its table where others have measures.
    case $name in pbs-build | pbs-compare) continue ;; esac
    of_program "$name" >"$TMPDIR/made"
    of_page "man/$name.1" Measures >"$TMPDIR/told"
    # Import names each kind of what it leaves out; the others point to it.
    [ "$name" != pbs-import ] || sed -i 's/^skipped_[a-z]*$/skipped_.../' "$TMPDIR/told" && sort -u -o "$TMPDIR/told" "$TMPDIR/told"
    compare "$name"
    programs=$((programs + 1))
done
grep -oE '"skipped_[a-z]+"' cmd/notes.c | tr -d '"' | sort >"$TMPDIR/made"
of_page man/pbs-import.1 Measures | grep '^skipped_' >"$TMPDIR/told"
compare "what is left out"
literals cmd/tool.c | grep -v record_bytes | sort >"$TMPDIR/made"
of_page man/pbs.7 'Measures of all programs' >"$TMPDIR/told"
compare pbs.7
[ $programs -ge 10 ] && [ -s "$TMPDIR/made" ] || { echo "no measures found"; bad=1; }
exit $bad
