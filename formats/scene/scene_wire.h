/* scene_wire.h: sizes that scene_write.c and scene_read.c share; pbs-container(5) says what is
 * in them. */
#ifndef PBS_SCENE_WIRE_H
#define PBS_SCENE_WIRE_H
enum {
    TEXTURE_FIXED = 8, /* u32 name bytes, u32 zero; then name, image file */
    USE_FIXED = 32,    /* u32 texture, u8 wrap u, u8 wrap v, u16 zero, f32 transform[6] */
    MATERIAL_USES_AT = 44,
    MATERIAL_NAME_AT = MATERIAL_USES_AT + 3 * USE_FIXED,
    MATERIAL_FIXED = MATERIAL_NAME_AT + 4
};
#endif
