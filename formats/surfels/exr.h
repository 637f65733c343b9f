/* exr.h: G-buffers as OpenEXR files (module "exr").
 *
 * One file a view with the parts position (P.X P.Y P.Z), normal (N.X N.Y N.Z), and as the scene
 * has them colour (R G B A: linear, half), material (metallic, roughness: half) and emissive
 * (E.R E.G E.B: linear, half). Positions are relative to the node's origin,
 * which the attribute pbsOrigin (v3d) of each part says. A pixel that nothing covers has N = 0.
 */
#ifndef PBS_EXR_H
#define PBS_EXR_H

#include "libcore/gbuffer/gbuffer.h"

/* Makes a folder, if it is not there. */
pbs_code pbs_exr_folder(const char *dir, pbs_err *err);

/* Writes DIR/view0.exr and so on; DIR is made if it is not there. */
pbs_code pbs_exr_write_view(pbs_run *run, const char *dir, const double origin[3],
                            const pbs_gbuffer_view *view, pbs_err *err);

/* Appends the covered pixels of all views in a file to *points, whose room is *cap: reads files
 * as written above, and those of any renderer that gives planes P.X P.Y P.Z and N.X N.Y N.Z (also
 * with the layer names "position" and "normal", or .R .G .B or .x .y .z at the end), and R G B A.
 * In a file with several views each part has its own P. channels: in, what *points has so far (0
 * for none); out. origin: in, that of the views so far; out: that of all, 0 if
 * the files do not say one. Errors: PBS_DATA for a file without P or N. */
pbs_code pbs_exr_read_views(pbs_run *run, const char *path, uint32_t *channels, pbs_points *points,
                            size_t *cap, double origin[3], pbs_err *err);
#endif
