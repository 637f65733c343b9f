#include "formats/surfels/octaves.h"

pbs_record pbs_octave_record(uint32_t channels) {
    return pbs_record_make(channels & ~(uint32_t)(PBS_POSITION | PBS_SPACING), false);
}

uint64_t pbs_octave_entries(const pbs_record *entry, uint64_t surfels) {
    return entry->stride ? pbs_octave_begin((size_t)surfels, 0) : 0;
}

pbs_code pbs_octaves_write(pbs_run *run, pbs_writer *w, const pbs_record *entry, uint32_t node,
                           const pbs_points *entries, uint32_t limit, pbs_err *err) {
    if (!entry->stride) return PBS_OK;
    return pbs_records_write(run, w, PBS_TAG_OCTAVES, entry, node, entries, 0, limit, NULL, err);
}
