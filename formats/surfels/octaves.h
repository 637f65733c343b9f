/* octaves.h: the OCTV chunk: colours, normals and materials of early prefixes.
 *
 * Of a node with N surfels it holds, coarse octaves first, pbs_octave_begin(N, 0) entries
 * (libcore/surfels/average.h has the rule), each with the channels of the header's line without
 * position and spacing, encoded and in the order as there. A node has all of them or none. Like
 * points they may be in several chunks, one after the other. In streams they come between the
 * node's points and the node, in archives in front of its points.
 */
#ifndef PBS_FORMAT_OCTAVES_H
#define PBS_FORMAT_OCTAVES_H

#include "formats/surfels/points.h"
#include "libcore/surfels/average.h"

#define PBS_TAG_OCTAVES PBS_TAG('O', 'C', 'T', 'V')

/* The record of an entry in a file with those channels; stride 0: there is nothing to say, and no
 * chunk. It is read with pbs_points_fit and pbs_points_read. */
pbs_record pbs_octave_record(uint32_t channels);

/* Entries of a node of that many surfels. */
uint64_t pbs_octave_entries(const pbs_record *entry, uint64_t surfels);

/* Writes all entries of a node, in chunks of at most `limit`; nothing if there are none. */
pbs_code pbs_octaves_write(pbs_run *run, pbs_writer *w, const pbs_record *entry, uint32_t node,
                           const pbs_points *entries, uint32_t limit, pbs_err *err);
#endif
