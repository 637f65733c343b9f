/* flatten_cloud.h: what pbs-flatten does with point clouds. */
#ifndef PBS_FLATTEN_CLOUD_H
#define PBS_FLATTEN_CLOUD_H

#include "cmd/tool.h"
#include "formats/codec.h"
#include "formats/file.h"

/* Whether the input begins like a stream of ours, or is empty. */
pbs_code pbs_flatten_is_stream(pbs_input *in, bool *is, pbs_err *err);
/* Opens the first operand and looks whether it is a stream of ours. If not, all operands are point
 * clouds: *done, and the archive is written. Else the input is the caller's. */
pbs_code pbs_flatten_clouds(pbs_app *app, pbs_codec codec, pbs_input *first, bool *done,
                            pbs_err *err);
#endif
