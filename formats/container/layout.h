/* layout.h: sizes and places inside header, chunk header, directory entry and footer, shared by
 * writer.c and reader.c and by nobody else. pbs-container(5) has the same numbers in words. */
#ifndef PBS_LAYOUT_H
#define PBS_LAYOUT_H

/* PNG's trick: a high bit, a line end that text mode changes, an end-of-file for DOS. */
#define PBS_MAGIC "\x89PBS\r\n\x1a\n"
#define PBS_END   "PBS END\n"

enum {
    HEADER_FIXED = 64, /* then the text, zeros up to PBS_ALIGN */
    HEADER_BYTES_AT = 8,
    HEADER_MAJOR_AT = 12,
    HEADER_MINOR_AT = 14,
    HEADER_INCOMPAT_AT = 16,
    HEADER_COMPAT_AT = 24,
    HEADER_TEXT_AT = 32, /* bytes of text */
    HEADER_CRC_AT = 60,  /* of the whole header with this field as zero */

    CHUNK_FIXED = 64, /* then the payload, zeros up to PBS_ALIGN */
    CHUNK_TAG_AT = 0,
    CHUNK_FLAGS_AT = 4,
    CHUNK_NODE_AT = 8,
    CHUNK_COUNT_AT = 12,
    CHUNK_BYTES_AT = 16,
    CHUNK_RAW_AT = 24,
    CHUNK_CRC_AT = 32,
    CHUNK_FIRST_AT = 36,
    CHUNK_SEQUENCE_AT = 56,
    CHUNK_SELF_AT = 60,      /* CRC of bytes 0 .. 59 */
#define PBS_CODEC_MASK 0xffu /* of the flags, in chunk headers and entries */

    PAGE_FIXED = 16, /* u32 page, u32 pages, u64 entries in all pages */
    ENTRY_SIZE = 40,
    ENTRY_TAG_AT = 0,
    ENTRY_FLAGS_AT = 4,
    ENTRY_NODE_AT = 8,
    ENTRY_COUNT_AT = 12,
    ENTRY_OFFSET_AT = 16,
    ENTRY_BYTES_AT = 24,
    ENTRY_CRC_AT = 32,
    ENTRY_FIRST_AT = 36,

    FOOTER_FIXED = 64,
    FOOTER_DIR_AT = 0,
    FOOTER_DIR_BYTES_AT = 8,
    FOOTER_FILE_AT = 16,
    FOOTER_CHUNKS_AT = 24,
    /* CRC over the headers of all chunks but directory pages, each without its own CRC: one that
     * runs over data and its CRC would forget the data */
    FOOTER_CHAIN_AT = 32,
    FOOTER_CRC_AT = 52, /* of bytes 0 .. 51 */
    FOOTER_MAGIC_AT = 56
};
#endif
