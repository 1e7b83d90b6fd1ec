# Map 4ws2-paper. Made by codegen 0.1.0; do not edit, build again.
#
# For GNU make 3.81 or newer, after your own CPPFLAGS and CFLAGS:
#
#   include path/to/this/folder/ars.mk
#   your_program: $(ARS_OBJECTS)
#
# The rule of your_program links its prerequisites ($^), as make's own rules do. Nothing is written into this folder. Of your
# variables only CPPFLAGS changes: it gets the include folder. Rules that do not use it need $(ARS_INCLUDES).
#
# make splits names at blanks, so the path in the include line must have none. The path of the project may have blanks.

ARS_DIR := $(dir $(lastword $(MAKEFILE_LIST)))
ifeq ($(wildcard $(ARS_DIR)ars.mk),)
$(error the path by which ars.mk is included has a blank; make cannot have that)
endif

ARS_INCLUDES := -I$(ARS_DIR)include
# The same bits on every target: a fused multiply-add rounds once where the reference rounds twice.
ARS_CFLAGS := -std=c99 -ffp-contract=off -fno-unsafe-math-optimizations

ARS_SOURCES := $(addprefix $(ARS_DIR), \
    src/ars_calibration.c \
    src/ars_checksum.c \
    src/ars_map.c \
    src/ars_inputs.c \
    src/ars_limiter.c \
    src/ars_parameters.c \
    src/ars_law.c \
    src/ars_controller.c \
    src/ars_e2e.c \
    src/ars_can.c \
    src/ars_supervision.c \
    src/ars_task.c \
    src/ars_selftest.c)
# Not needed by the others, and the only one that calls the mathematical library: link it with -lm.
ARS_DYNAMICS_SOURCES := $(ARS_DIR)src/ars_dynamics.c

# Where the objects go, seen from where make runs.
ARS_OBJECT_DIR ?= obj/ars
ARS_OBJECTS := $(patsubst $(ARS_DIR)src/%.c,$(ARS_OBJECT_DIR)/%.o,$(ARS_SOURCES))
ARS_DYNAMICS_OBJECTS := $(patsubst $(ARS_DIR)src/%.c,$(ARS_OBJECT_DIR)/%.o,$(ARS_DYNAMICS_SOURCES))

CPPFLAGS += $(ARS_INCLUDES)

# No number that calibration may change becomes part of an instruction.
$(ARS_OBJECT_DIR)/ars_calibration.o: ARS_CFLAGS += -fno-lto

# A pattern: your own first target stays the default one.
$(ARS_OBJECT_DIR)/%.o: $(ARS_DIR)src/%.c $(wildcard $(ARS_DIR)include/*.h)
	@mkdir -p $(@D)
	$(CC) $(CPPFLAGS) $(ARS_INCLUDES) $(CFLAGS) $(TARGET_ARCH) $(ARS_CFLAGS) -c $< -o $@
