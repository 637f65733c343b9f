# batch.mk: archives of all scenes below a folder, with GNU make.
#
#     make -j4 -k -f batch.mk SCENES=exports ARCHIVES=archives PBSFLAGS='--count 200k'
#
# exports/hall/pump.glb becomes archives/hall/pump.glb.pbs; beside it are pump.glb.log, what was
# said about it, and pump.glb.d, the files that it was made of. Only what changed is built again: a
# scene, a file that it refers to, the options, pbs itself. An archive appears when it is whole, so
# make may be killed at any moment and started again. Scenes that failed are listed at the end; with
# -k all the others are built. Names may have blanks in them, but no backslashes and line ends.
#
# A Makefile of your own can set the variables and include this file.

SCENES   ?= .
ARCHIVES ?= archives
PBSFLAGS ?=
PBS      ?= pbs-build
# With several scenes at a time each has one thread and its part of the memory.
export PBS_THREADS ?= 1
export PBS_MEMORY ?= $(shell getconf -a | awk -v j='$(patsubst -j%,%,$(filter -j%,$(MAKEFLAGS)))' \
    '$$1 == "PAGESIZE" { b = $$2 } $$1 == "_PHYS_PAGES" { n = $$2 } $$1 == "_NPROCESSORS_ONLN" { c = $$2 } \
    END { printf "%d", n * b / 2 / (j ? j : "$(filter -j,$(MAKEFLAGS))" ? c : 1) }')

pbs_self  := $(firstword $(MAKEFILE_LIST))
pbs_blank := $(subst ,, )
pbs_quote  = '$(subst ','\'',$(1))'
pbs_from   = $(subst $(pbs_blank),\ ,$(SCENES))
pbs_to     = $(subst $(pbs_blank),\ ,$(ARCHIVES))
pbs_state  = $(call pbs_quote,$(ARCHIVES)/.pbs)

.PHONY: batch archives
.DELETE_ON_ERROR:
batch:
	@mkdir -p $(pbs_state) && rm -f $(pbs_state)/failed
	@$(MAKE) --no-print-directory -f $(call pbs_quote,$(pbs_self)) archives; s=$$?; \
	    if [ -s $(pbs_state)/failed ]; then echo "failed:"; sort $(pbs_state)/failed; fi; exit $$s
archives:

# A rule for each scene: patterns cannot have blanks in their stems, rules can.
define pbs_rules
{ s = substr($$0, 3); gsub(/[ \t#:]/, "\\\\&", s); gsub(/[$$]/, "$$$$", s);
  t = s; gsub(/%/, "\\%", t);
  printf "archives: $$(pbs_to)/%s.pbs\n", s;
  printf "$$(pbs_to)/%s.pbs: $$(pbs_from)/%s $$(pbs_to)/.pbs/options\n\t$$(pbs_recipe)\n", t, s;
  printf "-include $$(pbs_to)/%s.d\n", s }
endef
pbs_kinds = $(foreach k,glb gltf obj ply stl,-iname '*.$(k)' -o) -false
define pbs_scan
mkdir -p $(pbs_state) && cd $(pbs_state) &&
{ $(PBS) --version; echo $(call pbs_quote,$(PBSFLAGS)); } >options.new &&
{ cmp -s options.new options || mv options.new options; } && cd $(call pbs_quote,$(CURDIR)) &&
(cd $(call pbs_quote,$(SCENES)) && find . -name '.?*' -prune -o -type f \( $(pbs_kinds) \) -print) |
LC_ALL=C sort | awk $(call pbs_quote,$(pbs_rules)) >$(pbs_state)/rules && echo done
endef
define pbs_recipe
@mkdir -p "$$(dirname -- $(call pbs_quote,$@))"; log=$(call pbs_quote,$(@:.pbs=.log)); \
if $(PBS) $(PBSFLAGS) --depend $(call pbs_quote,$(@:.pbs=.d)) -o $(call pbs_quote,$@) -- $(call pbs_quote,$<) 2>"$$log"; \
then printf 'built: %s\n' $(call pbs_quote,$@); \
else s=$$?; printf '%s: ' $(call pbs_quote,$<) | cat - "$$log" | tail -n 1 >>$(pbs_state)/failed; exit $$s; fi
endef
ifneq ($(filter archives,$(MAKECMDGOALS)),)
ifneq ($(shell $(pbs_scan)),done)
$(error $(SCENES): the scenes cannot be listed)
endif
include $(pbs_to)/.pbs/rules
endif
