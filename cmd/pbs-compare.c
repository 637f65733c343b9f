/* pbs-compare: how far a picture is from the truth. */
#include "cmd/tool.h"
#include "formats/readers/image.h"
#include "libcore/measures/metrics.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

typedef struct options {
    bool json;
} options;

static const pbs_option table[] = {
    {0, "json", PBS_FLAG, offsetof(options, json), NULL, "print JSON", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-compare",
                              "Compares pictures with the truth: SSIM, PSNR, coverage",
                              "PICTURE... TRUTH",
                              2,
                              -1,
                              table,
                              sizeof table / sizeof table[0],
                              true};

static void print_json_number(const char *name, double v) {
    if (isfinite(v))
        printf(", \"%s\": %.6g", name, v);
    else
        printf(", \"%s\": null", name);
}

static void print_errors(const options *o, const char *name, bool first,
                         const pbs_picture_error *e) {
    if (o->json) {
        printf("{\"picture\": ");
        pbs_print_json_text(name, strlen(name));
        print_json_number("ssim", e->ssim);
        print_json_number("psnr", e->psnr);
        print_json_number("max", e->max);
        print_json_number("hole", e->hole);
        print_json_number("spill", e->spill);
        printf("}\n");
        return;
    }
    if (first)
        printf("%8s %8s %6s %8s %8s  picture\n", "ssim", "psnr/dB", "max", "hole/%", "spill/%");
    printf("%8.4f %8.2f %6.0f %8.3f %8.3f  %s\n", e->ssim, e->psnr, e->max, 100 * e->hole,
           100 * e->spill, name);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    int last = app->common.operand_count - 1;
    pbs_image truth = {0};
    pbs_code rc = pbs_image_read(&app->run, pbs_operand(app, last), &truth, err);
    for (int i = 0; i < last && !rc; i++) {
        const char *name = pbs_operand(app, i);
        pbs_image picture = {0};
        pbs_picture_error e;
        rc = pbs_image_read(&app->run, name, &picture, err);
        if (!rc && (rc = pbs_picture_compare(&app->run, &picture, &truth, &e, err)))
            pbs_fail_in(err, "%s", name);
        if (!rc) print_errors(opt, name, !i, &e);
        pbs_free(&app->run, picture.rgba);
    }
    pbs_free(&app->run, truth.rgba);
    return rc;
}

int main(int argc, char **argv) {
    options o = {0};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
