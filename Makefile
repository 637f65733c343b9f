# make            build everything into build/$(config)/{bin,lib/pbs}
# make demo       build, and take a real CAD assembly through the whole path to pictures
# make test       build, and run every test; the last line is "N passed, N failed"
# make report     error against run time; SCENE=FILE for your own scene, OUT=DIR, MAX_ERROR=E
# make scaling    cost over size, threads and memory; OUT=DIR, MOST=N triangles of the largest input
# make peers      beside what people use instead; needs optional packages: scripts/deps --peers
# make bench      figures, as ratios within one run; SCENES=DIR NAMES="..." for your own scenes
# make fuzz       a minute of damaged files, with clang's fuzzer
# make lint       layers, headers, man pages, formatting
# make install    PREFIX=/usr/local DESTDIR=
# config=release (default) | debug | asan | tsan

config  ?= release
PREFIX  ?= /usr/local
DESTDIR ?=
CC      ?= cc
CXX     ?= c++
B       := build/$(config)

VERSION := 0.1.0

# One rule for floating point everywhere: no contraction, so that a portable build, an AVX2 build
# and a sanitized build write the same bytes.
common  := -g -Wall -Wextra -Wshadow -fvisibility=hidden -ffp-contract=off -fno-math-errno \
           -I. -DPBS_VERSION='"$(VERSION)"' -D_GNU_SOURCE -MMD -MP
opt_release := -O2
opt_debug   := -O0
opt_asan    := -O1 -fno-var-tracking -fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer
opt_tsan    := -O1 -fno-var-tracking -fsanitize=thread
ifeq ($(opt_$(config)),)
$(error config=$(config): one of release, debug, asan, tsan)
endif
ALLCFLAGS   := -std=c11 $(common) $(opt_$(config)) -Wstrict-prototypes -Wmissing-prototypes $(CFLAGS)
ALLCXXFLAGS := -std=c++17 $(common) -fPIC $(opt_$(config)) $(CXXFLAGS)
ALLLDFLAGS  := $(opt_$(config)) -pthread -Wl,--as-needed $(LDFLAGS)
LDLIBS      := -lm -ldl

core    := $(patsubst %.c,$(B)/obj/%.o,$(wildcard libcore/*/*.c))
formats := $(patsubst %.c,$(B)/obj/%.o,$(filter-out formats/foreign/%,$(wildcard formats/*/*.c)))
tool    := $(patsubst %.c,$(B)/obj/%.o,$(filter-out cmd/pbs-%,$(wildcard cmd/*.c)))
programs := $(patsubst cmd/%.c,$(B)/bin/%,$(wildcard cmd/pbs-*.c)) $(B)/bin/pbs-view $(B)/bin/pbs-build
view    := $(patsubst %.c,$(B)/obj/%.o,$(wildcard cmd/pbs-view/*.c cmd/pbs-view/*/*.c))
unit    := $(patsubst tests/unit/%.c,$(B)/tests/%,$(wildcard tests/unit/*.c)) $(B)/tests/test_cgal
benches := $(patsubst tests/bench/%.c,$(B)/tests/%,$(wildcard tests/bench/bench_*.c))

# A module is built if its libraries are here; otherwise the build says so and goes on.
have = $(shell printf '$(foreach h,$(1),\043include <$(h)>\n)' | $(CXX) $(2) -E -xc++ - >/dev/null 2>&1 && echo yes)
flags_gltf  :=
libs_gltf   := -ldraco -lsimdjson -lmeshoptimizer
flags_image := -isystem /usr/include/Imath
libs_image  := -lOpenImageIO -lOpenImageIO_Util -lz
flags_exr   := -I/usr/include/OpenEXR -I/usr/include/Imath
libs_exr    := -lOpenEXRCore
# CGAL's intervals need their rounding; gcc sees in its headers what is not there.
flags_mend  := -frounding-math -Wno-maybe-uninitialized
libs_mend   := -lmpfr -lgmp
flags_zstd  :=
libs_zstd   := -lzstd
flags_meshopt :=
libs_meshopt := -lmeshoptimizer
flags_draco :=
libs_draco  := -ldraco
modules :=
ifeq ($(call have,tiny_gltf.h draco/compression/decode.h nlohmann/json.hpp simdjson.h meshoptimizer.h,$(flags_gltf)),yes)
modules += gltf
endif
ifeq ($(call have,OpenImageIO/imageio.h zlib.h,$(flags_image)),yes)
modules += image
endif
ifeq ($(call have,openexr.h,$(flags_exr)),yes)
modules += exr
endif
ifeq ($(call have,CGAL/Surface_mesh.h gmp.h mpfr.h,$(flags_mend)),yes)
modules += mend
endif
ifeq ($(call have,zstd.h,$(flags_zstd)),yes)
modules += zstd
endif
ifeq ($(call have,meshoptimizer.h,$(flags_meshopt)),yes)
modules += meshopt
endif
ifeq ($(call have,draco/compression/expert_encode.h,$(flags_draco)),yes)
modules += draco
endif
missing := $(filter-out $(modules),gltf image exr mend zstd meshopt draco)

.PHONY: all test demo report scaling peers bench fuzz lint install clean deps
.SECONDARY:
.DELETE_ON_ERROR:
all: $(programs) $(modules:%=$(B)/lib/pbs/%.so)
	@for m in $(missing); do echo "left out: the module $$m: its library is not installed (scripts/deps does that)"; done

deps:
	@scripts/deps

$(B)/obj/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(CC) $(ALLCFLAGS) -fPIC -c -o $@ $<
$(B)/libcore.a: $(core)
	@rm -f $@
	$(AR) rcs $@ $^
$(B)/libformats.a: $(formats)
	@rm -f $@
	$(AR) rcs $@ $^

$(B)/bin/pbs-view: $(view) $(tool) $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)
$(B)/bin/pbs-build: cmd/pbs-build Makefile
	@mkdir -p $(@D)
	sed 's/@VERSION@/$(VERSION)/' $< >$@
	@chmod 755 $@
$(B)/bin/pbs-%: $(B)/obj/cmd/pbs-%.o $(tool) $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)

# Shaders are compiled in: one C string each.
$(B)/obj/cmd/pbs-view/%.o: cmd/pbs-view/%.c $(B)/gen/shaders.h Makefile
	@mkdir -p $(@D)
	$(CC) $(ALLCFLAGS) -I$(B)/gen -c -o $@ $<
$(B)/gen/shaders.h: scripts/embed $(wildcard cmd/pbs-view/shaders/*.glsl)
	@mkdir -p $(@D)
	scripts/embed $(wildcard cmd/pbs-view/shaders/*.glsl) > $@

# A module NAME is formats/foreign/NAME.c or NAME.cpp and NAME_*.cpp, with NAME's flags.
module_flags = $(flags_$(firstword $(subst _, ,$*)))
$(B)/obj/formats/foreign/%.o: formats/foreign/%.cpp Makefile
	@mkdir -p $(@D)
	$(CXX) $(ALLCXXFLAGS) $(module_flags) -c -o $@ $<
$(B)/obj/formats/foreign/%.o: formats/foreign/%.c Makefile
	@mkdir -p $(@D)
	$(CC) $(ALLCFLAGS) -fPIC $(module_flags) -c -o $@ $<
define module_rule
$(B)/lib/pbs/$(1).so: $(patsubst %,$(B)/obj/%.o,$(basename $(wildcard formats/foreign/$(1).c formats/foreign/$(1).cpp formats/foreign/$(1)_*.cpp))) $(B)/libcore.a
	@mkdir -p $$(@D)
	$(CXX) $(ALLLDFLAGS) -shared -o $$@ $$^ $(libs_$(1))
endef
$(foreach m,$(modules),$(eval $(call module_rule,$(m))))

# Its test packs with the library what the module unpacks.
ifeq ($(call have,meshoptimizer.h,),yes)
$(B)/tests/test_gltf_meshopt: LDLIBS += -lmeshoptimizer
endif
# The player's tests have its parts, but not its main.
player_tests := test_view test_cut test_store test_draw test_draw_voxel test_path test_play test_canvas \
    test_splat test_reduce test_shaders
$(player_tests:%=$(B)/tests/%): $(B)/tests/%: $(B)/obj/tests/unit/%.o \
    $(filter-out %/main.o,$(view)) $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)
$(B)/tests/%: $(B)/obj/tests/unit/%.o $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)
# Compares with CGAL, and says so if that is not there.
$(B)/obj/tests/oracle/%.o: tests/oracle/%.cpp Makefile
	@mkdir -p $(@D)
	$(CXX) $(ALLCXXFLAGS) $(flags_mend) -c -o $@ $<
$(B)/tests/test_cgal: $(B)/obj/tests/oracle/test_cgal.o $(B)/libcore.a
	@mkdir -p $(@D)
	$(CXX) $(ALLLDFLAGS) -o $@ $^ $(if $(filter mend,$(modules)),$(libs_mend)) $(LDLIBS)
# So has the player's bench.
$(B)/tests/bench_view: $(B)/obj/tests/bench/bench_view.o $(filter-out %/main.o,$(view)) \
    $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)
$(B)/tests/bench_%: $(B)/obj/tests/bench/bench_%.o $(B)/obj/cmd/pbs-view/draw/gl.o $(B)/libformats.a $(B)/libcore.a
	@mkdir -p $(@D)
	$(CC) $(ALLLDFLAGS) -o $@ $^ $(LDLIBS)

test: deps
	@$(MAKE) --no-print-directory config=$(config) all test-programs
	@tests/run $(B)
.PHONY: test-programs
test-programs: $(unit)
demo_scene := /usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb
demo: deps
	@$(MAKE) --no-print-directory config=$(config) all
	@scripts/demo $(B)
report: deps
	@$(MAKE) --no-print-directory config=$(config) all
	@scripts/report $(B) $(or $(OUT),$(B)/report) $(if $(MAX_ERROR),--max-error $(MAX_ERROR)) "$(or $(SCENE),$(demo_scene))"
scaling: deps
	@$(MAKE) --no-print-directory config=$(config) all
	@scripts/scaling $(B) $(or $(OUT),$(B)/scaling) $(if $(MOST),--most $(MOST))
peers: all
	@scripts/peers $(B)
bench: all $(benches)
	@scripts/bench $(B) $(if $(SCENES),"$(SCENES)" $(NAMES))
# Mutates small valid files and looks whether the checker survives; needs clang with libFuzzer.
fuzz: $(modules:%=$(B)/lib/pbs/%.so)
	@mkdir -p build/fuzz/corpus
	clang -g -O1 -std=c11 -D_GNU_SOURCE -DPBS_VERSION='"$(VERSION)"' -I. -fsanitize=fuzzer,address,undefined -o build/fuzz/container \
	    tests/fuzz/fuzz_container.c $(filter-out formats/foreign/%,$(wildcard formats/*/*.c)) libcore/*/*.c -lm -ldl -pthread
	PBS_MODULES=$(B)/lib/pbs build/fuzz/container -max_total_time=60 -max_len=8192 -timeout=10 build/fuzz/corpus
lint:
	@scripts/lint

install: all
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/lib/pbs $(addprefix $(DESTDIR)$(PREFIX)/share/,pbs $(addprefix man/man,1 5 7))
	install -m 755 $(programs) $(DESTDIR)$(PREFIX)/bin
	$(if $(modules),install -m 644 $(modules:%=$(B)/lib/pbs/%.so) $(DESTDIR)$(PREFIX)/lib/pbs)
	install -m 644 scripts/batch.mk $(DESTDIR)$(PREFIX)/share/pbs
	for s in 1 5 7; do install -m 644 man/*.$$s $(DESTDIR)$(PREFIX)/share/man/man$$s; done

clean:
	rm -rf build

-include $(shell find $(B) -name '*.d' 2>/dev/null)
