/* Every program that the player uses, in every form, is valid GLSL 4.50 for glslangValidator, the
 * reference compiler (Debian: glslang-tools), which knows forms that this machine's driver never
 * compiles. The sources are caught on their way to the driver, which has to be there (Mesa's
 * software will do), so that none is forgotten: what lies in the folder of the player and was not
 * caught fails. */
#include "cmd/pbs-view/draw/draw.h"
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/draw/reduce.h"
#include "cmd/pbs-view/draw/splat.h"
#include "tests/check.h"
#include <glob.h>
#include <unistd.h>

enum { STAGES = 64, SOURCE = 1 << 16, SIDE = 32 };

static pbs_run run = {.threads = 1};
static pbs_gl gl, driver;
static pbs_gl_context *context;
static pbs_err err;

typedef struct stage {
    GLenum kind;
    GLuint shader, program;
    char *text;
} stage;
static stage stages[STAGES];
static int stage_count;
static bool lie; /* everything compiles, and the device has every extension */

static GLuint APIENTRY create_shader(GLenum kind) {
    GLuint id = driver.CreateShader(kind);
    if (stage_count < STAGES) stages[stage_count++] = (stage){kind, id, 0, calloc(SOURCE, 1)};
    return id;
}

static stage *stage_of(GLuint shader) {
    for (int i = stage_count; i-- > 0;)
        if (stages[i].shader == shader) return &stages[i];
    return NULL;
}

static void APIENTRY shader_source(GLuint shader, GLsizei n, const GLchar *const *part,
                                   const GLint *length) {
    stage *s = stage_of(shader);
    for (GLsizei i = 0; i < n && s; i++) strncat(s->text, part[i], SOURCE - 1 - strlen(s->text));
    driver.ShaderSource(shader, n, part, length);
}

static void APIENTRY attach_shader(GLuint program, GLuint shader) {
    stage *s = stage_of(shader);
    if (s) s->program = program;
    driver.AttachShader(program, shader);
}

static void APIENTRY get_shader(GLuint shader, GLenum what, GLint *out) {
    driver.GetShaderiv(shader, what, out);
    if (lie) *out = GL_TRUE;
}

static void APIENTRY get_program(GLuint program, GLenum what, GLint *out) {
    driver.GetProgramiv(program, what, out);
    if (lie) *out = GL_TRUE;
}

static const char *const extensions[] = {"GL_NV_shader_atomic_int64", "GL_ARB_gpu_shader_int64"};

static void APIENTRY get_integer(GLenum what, GLint *out) {
    driver.GetIntegerv(what, out);
    if (lie && what == GL_NUM_EXTENSIONS) *out = 2;
}

static const GLubyte *APIENTRY get_string(GLenum what, GLuint i) {
    return lie && what == GL_EXTENSIONS ? (const GLubyte *)extensions[i]
                                        : driver.GetStringi(what, i);
}

static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code != -1) return code != PBS_OK;
    code = pbs_gl_context_new("sw", &context, &gl, &err);
    if (code) return true;
    driver = gl;
    gl.CreateShader = create_shader;
    gl.ShaderSource = shader_source;
    gl.AttachShader = attach_shader;
    gl.GetShaderiv = get_shader;
    gl.GetProgramiv = get_program;
    gl.GetIntegerv = get_integer;
    gl.GetStringi = get_string;
    return false;
}

static void expect(pbs_code rc) {
    if (rc) printf("# %s\n", err.text);
    CHECK(rc == PBS_OK);
}

/* ---- each program is made by whoever draws with it, when it first does ---- */

static void draw_nodes(pbs_canvas *c) {
    static const uint8_t record[16] = {0};
    static const uint32_t place[1] = {0};
    const pbs_voxels v = {.place = (uint32_t *)place, .count = 1};
    const pbs_surfels surfel = {.records = record, .prefix = 1, .whole = 1, .radius = 1, .step = 1};
    const pbs_cubes cube = {
        .chunks = &v, .chunk_count = 1, .side = 1, .m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    const pbs_voxel_mode noted = {.frame = 1, .all = 1};
    static const pbs_material look = {0};
    pbs_placed_mesh mesh[2] = {
        {.position = 0, .normal = -1, .uv = -1, .colour = -1, .triangle_material = -1}};
    GLuint buffer;
    gl.CreateBuffers(1, &buffer);
    gl.NamedBufferData(buffer, 256, NULL, GL_STATIC_DRAW);
    mesh[0].buffer = buffer;
    mesh[1] = mesh[0];
    mesh[1].look = &look;
    mesh[1].uv = 0;
    expect(pbs_canvas_surfels(c, &surfel, 1, &err));
    expect(pbs_canvas_voxels(c, &cube, 1, NULL, &err));
    expect(pbs_canvas_voxels(c, &cube, 1, &noted, &err));
    expect(pbs_canvas_triangles(c, mesh, 2, &(pbs_palette){0}, &err));
    gl.DeleteBuffers(1, &buffer);
}

static void cast_points(pbs_canvas *c, bool wide) {
    const pbs_frame f = {.camera = {.unit = 1, .tan_half = 1, .back = {0, 0, 1}}};
    pbs_reduce *reduce;
    bool whole;
    expect(pbs_reduce_new(&run, &gl, 16, &reduce, &err));
    expect(pbs_reduce_step(reduce, &f.camera, 1, NULL, 0, &(pbs_reduce_options){0}, &whole, &err));
    lie = wide;
    /* What the driver has not compiled cannot be drawn with. */
    pbs_code rc = pbs_reduce_cast(reduce, c, &(pbs_reduce_options){0}, &err);
    CHECK(wide || rc == PBS_OK);
    lie = false;
    pbs_reduce_free(reduce);
}

static void make_all(void) {
    const pbs_frame f = {.camera = {.unit = 1, .tan_half = 1, .back = {0, 0, 1}}};
    pbs_canvas *c;
    pbs_text *text;
    pbs_splat *splat;
    expect(pbs_canvas_new(&run, &gl, &(pbs_canvas_desc){SIDE, SIDE, 1}, &c, &err));
    expect(pbs_canvas_begin(c, &f, &err));
    draw_nodes(c);
    expect(pbs_text_new(&run, &gl, &text, &err));
    pbs_text_free(text);
    expect(pbs_splat_new(&run, &gl, &splat, &err));
    pbs_splat_free(splat);
    cast_points(c, false);
    cast_points(c, true);
    pbs_canvas_free(c);
}

/* ---- what was caught ---- */

static char *contents(const char *path) {
    char *text = calloc(SOURCE, 1);
    FILE *f = fopen(path, "r");
    if (!f || fread(text, 1, SOURCE - 1, f) == 0) text[0] = 0;
    if (f) fclose(f);
    return text;
}

static bool defines(const stage *s, const char *name) {
    char line[80];
    snprintf(line, sizeof line, "#define %s\n", name);
    return strstr(s->text, line) != NULL;
}

/* A file was part of some shader; with each of its conditions, and without. */
static void check_caught(const char *path) {
    char *text = contents(path), name[60];
    bool caught = false;
    for (int i = 0; i < stage_count; i++) caught = caught || strstr(stages[i].text, text);
    if (!caught || !text[0]) printf("# %s was not caught\n", path);
    CHECK(caught && text[0]);
    for (const char *p = text; (p = strstr(p, "#if")); p++) {
        bool with = false, without = false;
        if (sscanf(p, "#if%*[n]def %59s", name) != 1 && sscanf(p, "#ifdef %59s", name) != 1) {
            printf("# %s: a condition other than #ifdef\n", path);
            pbs_bad++;
            break;
        }
        for (int i = 0; i < stage_count; i++)
            if (strstr(stages[i].text, text))
                *(defines(&stages[i], name) ? &with : &without) = true;
        if (!with || !without) printf("# %s: %s is always the same\n", path, name);
        CHECK(with && without);
    }
    free(text);
}

static void check_all_caught(void) {
    const char *top = getenv("PBS_TOP");
    char pattern[600];
    glob_t files;
    snprintf(pattern, sizeof pattern, "%s/cmd/pbs-view/shaders/*.glsl", top ? top : ".");
    CHECK(glob(pattern, 0, NULL, &files) == 0);
    CHECK(files.gl_pathc > 10);
    for (size_t i = 0; i < files.gl_pathc; i++) check_caught(files.gl_pathv[i]);
    globfree(&files);
}

static const char *ending(GLenum kind) {
    return kind == GL_VERTEX_SHADER ? "vert" : kind == GL_FRAGMENT_SHADER ? "frag" : "comp";
}

/* The stages of the program that stage `first` begins, alone and linked. SPIR-V wants places for
 * what links by name here; they are given out. */
static void validate(int first) {
    char names[400] = "", path[100], command[900];
    for (int i = first; i < stage_count && stages[i].program == stages[first].program; i++) {
        const stage *s = &stages[i];
        snprintf(path, sizeof path, "program%d.%s", first, ending(s->kind));
        strcat(strcat(names, " "), path);
        FILE *f = fopen(path, "w");
        CHECK(f && fputs(s->text, f) >= 0);
        if (f) fclose(f);
    }
    snprintf(command, sizeof command,
             "glslangValidator -l%s >messages && glslangValidator --target-env opengl "
             "--auto-map-locations --auto-map-bindings -o program.spv%s >messages || "
             "{ sed 's/^/# /' messages; exit 1; }",
             names, names);
    fflush(stdout);
    CHECK(system(command) == 0);
    snprintf(command, sizeof command, "rm -f messages program.spv%s", names);
    CHECK(system(command) == 0);
}

TEST(shaders_are_valid) {
    char folder[] = "shaders.XXXXXX";
    if (no_gl()) SKIP(err.text);
    if (system("command -v glslangValidator >/dev/null 2>&1"))
        SKIP("the Debian package glslang-tools is not installed");
    make_all();
    CHECK(stage_count < STAGES);
    check_all_caught();
    CHECK(mkdtemp(folder) && chdir(folder) == 0);
    for (int i = 0; i < stage_count; i++)
        if (!i || stages[i].program != stages[i - 1].program) validate(i);
    CHECK(chdir("..") == 0 && rmdir(folder) == 0);
    for (int i = 0; i < stage_count; i++) free(stages[i].text);
    CHECK(pbs_mem_used(&run) == 0);
}

/* What a strict driver would refuse, this one does not; what all of them refuse fails. */
TEST(what_the_driver_says_is_an_error) {
    setenv("PBS_GL_DEBUG", "1", 1);
    pbs_gl own;
    pbs_gl_context *debug;
    if (pbs_gl_context_new("sw", &debug, &own, &err)) SKIP(err.text);
    own.BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1 << 20, 0);
    CHECK(pbs_gl_check(&own, "binding", &err) == PBS_INTERNAL);
    CHECK(strstr(err.text, "BindBuffer") != NULL); /* it has more to say than a number */
    CHECK(pbs_gl_check(&own, "nothing", &err) == PBS_OK);
    pbs_gl_context_free(debug);
}

TEST_MAIN
