/* image.h: pictures in and out. PPM and PAM are read and written here, because they are a line
 * of text and the pixels; every other format goes through the module "image" (OpenImageIO). */
#ifndef PBS_IMAGE_H
#define PBS_IMAGE_H

#include "libcore/data/mesh.h"
#include "libcore/ground/run.h"

/* out->rgba belongs to the caller: pbs_free. */
pbs_code pbs_image_read(pbs_run *run, const char *path, pbs_image *out, pbs_err *err);
/* The same from bytes, for textures inside a scene; name is for messages. */
pbs_code pbs_image_decode(pbs_run *run, const char *name, const void *bytes, size_t size,
                          pbs_image *out, pbs_err *err);
/* The format follows from the ending: .ppm (alpha is lost), .pam, else OpenImageIO. The file is
 * written beside and renamed when whole. */
pbs_code pbs_image_write(pbs_run *run, const char *path, const pbs_image *image, pbs_err *err);
#endif
