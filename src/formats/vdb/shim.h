/* The C face of OpenVDB that Rust sees. Plain structs and opaque handles only; every function that
 * can fail takes a status and returns its code. Nothing here throws. Matrices are OpenVDB's own
 * row-vector ones, row by row. Index boxes are inclusive. */
#ifndef CUMULO_VDB_SHIM_H
#define CUMULO_VDB_SHIM_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    CUMULO_VDB_OK = 0,
    CUMULO_VDB_FAILED = 1,       /* OpenVDB or the standard library said no */
    CUMULO_VDB_OUT_OF_MEMORY = 2,
    CUMULO_VDB_UNKNOWN = 3,      /* something that is not a std::exception was thrown */
    CUMULO_VDB_UNSUPPORTED = 4,  /* this grid type or transform cannot do that */
    CUMULO_VDB_IO = 5            /* the operating system said no: see os_error */
};

typedef struct cumulo_vdb_status {
    int32_t code;
    int32_t os_error;  /* errno, with CUMULO_VDB_IO */
    char message[504]; /* NUL-terminated, cut to fit, any bytes */
} cumulo_vdb_status;

typedef struct cumulo_vdb_grid cumulo_vdb_grid;
typedef struct cumulo_vdb_meta cumulo_vdb_meta;
typedef struct cumulo_vdb_leaves cumulo_vdb_leaves;
typedef struct cumulo_vdb_loading cumulo_vdb_loading;

typedef struct cumulo_vdb_info {
    char value_type[48]; /* "float", "vec3s", ... */
    char grid_type[128]; /* "Tree_float_5_4_3" */
    char map_type[64];   /* "UniformScaleMap", ... */
    int32_t grid_class;  /* 0 unknown, 1 level set, 2 fog volume, 3 staggered */
    int32_t saved_as_half;
    int32_t linear;      /* matrix is meaningful */
    int32_t components;  /* 1 or 3 where values can be read, else 0 */
    double matrix[16];
    double background[3];
    int32_t box_min[3];
    int32_t box_max[3];
    uint64_t active_voxels;
    uint64_t leaf_count;
    uint64_t active_tiles;
    uint64_t memory;
} cumulo_vdb_info;

enum {
    CUMULO_VDB_META_OTHER = 0,
    CUMULO_VDB_META_BOOL = 1,
    CUMULO_VDB_META_INT = 2,
    CUMULO_VDB_META_FLOAT = 3,
    CUMULO_VDB_META_TEXT = 4,
    CUMULO_VDB_META_INTS = 5,
    CUMULO_VDB_META_FLOATS = 6
};

typedef struct cumulo_vdb_meta_entry {
    const char* name; /* valid until the handle is freed or changed */
    size_t name_length;
    const char* type;
    size_t type_length;
    const char* text;
    size_t text_length;
    int32_t kind;
    int32_t count; /* of ints or floats */
    int64_t ints[4];
    double floats[16];
} cumulo_vdb_meta_entry;

typedef struct cumulo_vdb_tile {
    int32_t origin[3];
    int32_t dim;
    float value[3];
    int32_t active;
} cumulo_vdb_tile;

/* Points, triangles and quads of the surface of a value. */
typedef struct cumulo_vdb_surface cumulo_vdb_surface;
typedef struct cumulo_vdb_surface_counts {
    size_t points;
    size_t triangles;
    size_t quads;
    int32_t finite; /* 0 where values beside the surface are NaN or infinite, so that it has no place there */
} cumulo_vdb_surface_counts;

/* Triangles and quads in index space; the fourth corner of a triangle is UINT32_MAX, other corners are below the number
 * of points. */
typedef struct cumulo_vdb_polygons {
    const double (*points)[3];
    size_t point_count;
    const uint32_t (*corners)[4];
    size_t polygon_count;
} cumulo_vdb_polygons;

/* Version of OpenVDB: "10.0.1". Its major and minor number are those of the library that is loaded, whose symbols have
 * them in their names. */
const char* cumulo_vdb_version(void);

/* What is called in the place of an abort where the library throws and nobody can catch it: out of destructors and of
 * its own threads. The handler must not return. */
void cumulo_vdb_on_terminate(void (*handler)(const char* what));

/* Files whose bytes lie in memory, and whose every length was checked there. Nothing is read lazily. */
/* Metadata of the file as a whole. */
int32_t cumulo_vdb_file_meta(const uint8_t* bytes, size_t length, cumulo_vdb_meta** out, cumulo_vdb_status* status);
/* The last grid of the file, which may share the tree of one before. */
int32_t cumulo_vdb_file_grid(const uint8_t* bytes, size_t length, cumulo_vdb_grid** out, cumulo_vdb_status* status);
/* Writes a grid to nowhere, which touches every byte of every attribute: for a process that may die of it. */
int32_t cumulo_vdb_touch(const cumulo_vdb_grid* grid, cumulo_vdb_status* status);
/* All of a grid but its leaves' buffers, in memory: every length in it was checked. */
typedef struct cumulo_vdb_layout {
    const uint8_t* bytes; /* from the compression flags on */
    size_t length;
    int32_t half;
    const char* grid_type; /* "Tree_float_5_4_3" */
    uint32_t file_version;
    uint32_t library[2]; /* version of the library that wrote it */
    uint64_t leaf_count;
} cumulo_vdb_layout;
/* Decodes all of a grid but its leaves' buffers; then those, in file order from leaf `first` on, that these bytes are
 * (thread-safe for different leaves); then hands over the grid, or, where `out` is null, drops it. The end consumes the
 * handle whatever it returns. */
int32_t cumulo_vdb_load_begin(const cumulo_vdb_layout* layout, cumulo_vdb_loading** out, cumulo_vdb_status* status);
int32_t cumulo_vdb_load_leaves(const cumulo_vdb_loading* loading, size_t first, size_t count, const uint8_t* bytes,
                               size_t length, cumulo_vdb_status* status);
/* Places of a leaf's origin, its 512 values and its active mask. */
typedef struct cumulo_vdb_leaf {
    int32_t (*origin)[3];
    float (*values)[512];
    uint64_t (*active)[8];
} cumulo_vdb_leaf;
/* Decodes leaves of scalars as `cumulo_vdb_load_leaves` does, copies them, and keeps no values. */
int32_t cumulo_vdb_load_values(const cumulo_vdb_loading* loading, size_t first, size_t count, const uint8_t* bytes,
                               size_t length, const cumulo_vdb_leaf* out, cumulo_vdb_status* status);
int32_t cumulo_vdb_load_end(cumulo_vdb_loading* loading, cumulo_vdb_grid** out, cumulo_vdb_status* status);
/* Writes a file from byte 0 of an open descriptor on, which stays the caller's. `values` is null, or has for each grid
 * the values of its leaves in ascending order of origin: the grids are float ones whose leaves have none. `meta` may be
 * null. `codec`: 0 none, 1 Blosc. `length` is the file's length; after CUMULO_VDB_IO too, where it is what would have been
 * needed. */
int32_t cumulo_vdb_write(int32_t fd, const cumulo_vdb_grid* const* grids, const float* const* const* values,
                         size_t count, const cumulo_vdb_meta* meta, int32_t codec, uint64_t* length,
                         cumulo_vdb_status* status);

/* Metadata. A handle from a grid is a view of that grid and keeps it alive. */
int32_t cumulo_vdb_meta_new(cumulo_vdb_meta** out, cumulo_vdb_status* status);
void cumulo_vdb_meta_free(cumulo_vdb_meta* meta);
int32_t cumulo_vdb_meta_count(const cumulo_vdb_meta* meta, size_t* out, cumulo_vdb_status* status);
int32_t cumulo_vdb_meta_get(cumulo_vdb_meta* meta, size_t index, cumulo_vdb_meta_entry* out,
                            cumulo_vdb_status* status);
int32_t cumulo_vdb_meta_set(cumulo_vdb_meta* meta, const cumulo_vdb_meta_entry* entry, cumulo_vdb_status* status);

/* Grids. */
void cumulo_vdb_grid_free(cumulo_vdb_grid* grid);
int32_t cumulo_vdb_grid_info(const cumulo_vdb_grid* grid, cumulo_vdb_info* out, cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_meta(cumulo_vdb_grid* grid, cumulo_vdb_meta** out, cumulo_vdb_status* status);
/* Drops the entries that OpenVDB keeps for itself and that have another type than it gives them: it could not write
 * the grid with them. `dropped` counts them; `first` holds the name of one. */
int32_t cumulo_vdb_grid_mend_meta(cumulo_vdb_grid* grid, uint64_t* dropped, char (*first)[64],
                                  cumulo_vdb_status* status);

/* Leaves in ascending order of origin; copying is thread-safe. */
int32_t cumulo_vdb_leaves_new(const cumulo_vdb_grid* grid, cumulo_vdb_leaves** out, cumulo_vdb_status* status);
void cumulo_vdb_leaves_free(cumulo_vdb_leaves* leaves);
/* How many there are, and the values that each of their voxels has. */
int32_t cumulo_vdb_leaves_count(const cumulo_vdb_leaves* leaves, size_t* count, int32_t* components,
                                cumulo_vdb_status* status);
/* `values` has room for `capacity` numbers, at least 512 times the grid's components, which come interleaved; `active`
 * for 8 words. Fails for an index that is not below the count, and where there is less room. */
int32_t cumulo_vdb_leaves_copy(const cumulo_vdb_leaves* leaves, size_t index, int32_t* origin, float* values,
                               size_t capacity, uint64_t* active, cumulo_vdb_status* status);
/* Active tiles and inactive ones whose value is not the background. Writes up to `capacity` tiles
 * and always the true number; ask with capacity 0 first. */
int32_t cumulo_vdb_tiles(const cumulo_vdb_grid* grid, cumulo_vdb_tile* tiles, size_t capacity, size_t* count,
                         cumulo_vdb_status* status);

/* Whether two grids of one type have the same nodes, masks and values, in the type's own precision. */
int32_t cumulo_vdb_grid_same(const cumulo_vdb_grid* a, const cumulo_vdb_grid* b, int32_t* same,
                             cumulo_vdb_status* status);

/* A float (components 1) or vec3s (components 3) grid. Where `values` is null, its leaves have no values. */
int32_t cumulo_vdb_grid_new(int32_t components, const float* background, const int32_t (*origins)[3],
                            const float* const* values, const uint64_t* const* active, size_t leaf_count,
                            const cumulo_vdb_tile* tiles, size_t tile_count, cumulo_vdb_grid** out,
                            cumulo_vdb_status* status);
/* An empty grid with background 0: float (kind 0), double (1), int32 (2) or vec3s (3). */
int32_t cumulo_vdb_grid_empty(int32_t kind, cumulo_vdb_grid** out, cumulo_vdb_status* status);
/* Values of all voxels of an inclusive box, active or not, in double precision: component `c` of voxel `low + i` lies at
 * `sum(strides[a] * i[a]) + c`. Strides are at least the number of components; `room` counts the numbers. */
int32_t cumulo_vdb_grid_read_box(const cumulo_vdb_grid* grid, const int32_t* low, const int32_t* high,
                                 const int64_t* strides, double* out, size_t room, cumulo_vdb_status* status);
/* Sets the voxels of a box whose values differ from 0 and makes them active; others stay as they are. For the types of
 * `cumulo_vdb_grid_empty`. At most `most` leaves are made; where more are needed, `made` is `most + 1` and the box is
 * written in part. */
int32_t cumulo_vdb_grid_write_box(cumulo_vdb_grid* grid, const int32_t* low, const int32_t* high,
                                  const int64_t* strides, const double* values, size_t room, uint64_t most,
                                  uint64_t* made, cumulo_vdb_status* status);
/* Makes a block of 8, 128 or 4096 voxels' edge active with one value, in a grid of scalars. */
int32_t cumulo_vdb_grid_add_tile(cumulo_vdb_grid* grid, const int32_t* origin, int32_t dim, double value,
                                 cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_set_name(cumulo_vdb_grid* grid, const char* name, cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_set_class(cumulo_vdb_grid* grid, int32_t grid_class, cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_set_half(cumulo_vdb_grid* grid, int32_t half, cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_set_matrix(cumulo_vdb_grid* grid, const double* matrix, cumulo_vdb_status* status);

/* Edits in place. */
int32_t cumulo_vdb_grid_crop(cumulo_vdb_grid* grid, const double* world_min, const double* world_max,
                             cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_prune(cumulo_vdb_grid* grid, double tolerance, cumulo_vdb_status* status);
/* Trilinear, onto a lattice with the given index-to-world matrix; `scale` takes the grid's own index coordinates to
 * those of that lattice, axis by axis. */
int32_t cumulo_vdb_grid_resample(cumulo_vdb_grid* grid, const double* matrix, const double* scale,
                                 cumulo_vdb_status* status);
/* By a box filter: a new voxel is the mean over its cell of the old lattice's cells. Arguments are those of
 * cumulo_vdb_grid_resample. */
int32_t cumulo_vdb_grid_resample_box(cumulo_vdb_grid* grid, const double* matrix, const double* scale,
                                     cumulo_vdb_status* status);
/* Distances become densities: 0 outside, rising to 1 across the inner half of the narrow band. Float and double. */
int32_t cumulo_vdb_grid_to_fog(cumulo_vdb_grid* grid, cumulo_vdb_status* status);
/* Densities become signed distances in world units to the surface of the value `iso`, negative where the density is at
 * least that; `voxel` is the edge of the cubic voxels, `half_width` that of the narrow band in voxels. Float and double. */
int32_t cumulo_vdb_grid_to_level_set(cumulo_vdb_grid* grid, double iso, double voxel, float half_width,
                                     cumulo_vdb_status* status);
/* The surface on which a grid has the value `iso`, in index space. `adaptivity`, 0 to 1, says how much flat parts are
 * merged. With `reverse` 0, corners run as OpenVDB has them for level sets: clockwise as seen from outside. The copy fails
 * where there is less room than the counts say. Float and double. */
int32_t cumulo_vdb_surface_new(const cumulo_vdb_grid* grid, double iso, double adaptivity, cumulo_vdb_surface** out,
                               cumulo_vdb_status* status);
void cumulo_vdb_surface_free(cumulo_vdb_surface* surface);
int32_t cumulo_vdb_surface_count(const cumulo_vdb_surface* surface, cumulo_vdb_surface_counts* out,
                                 cumulo_vdb_status* status);
int32_t cumulo_vdb_surface_copy(const cumulo_vdb_surface* surface, const cumulo_vdb_surface_counts* room,
                                int32_t reverse, double (*points)[3], uint32_t (*triangles)[3], uint32_t (*quads)[4],
                                cumulo_vdb_status* status);
/* A level set of a closed surface: floats, voxels of edge `voxel` with (0, 0, 0) at the origin, and a narrow band of
 * `half_width` voxels to each side. */
int32_t cumulo_vdb_grid_from_polygons(const cumulo_vdb_polygons* polygons, double voxel, float half_width,
                                      cumulo_vdb_grid** out, cumulo_vdb_status* status);
/* Multiplies every vector by a 3x3 matrix, given row by row, which acts on columns. */
int32_t cumulo_vdb_grid_turn_vectors(cumulo_vdb_grid* grid, const double* rows, cumulo_vdb_status* status);
/* A new grid of one component, 0 to 2, of a grid of vectors; and a new grid of vectors of three grids of scalars of one
 * type, whose places are those of the first. Class and vector type are not kept. */
int32_t cumulo_vdb_grid_component(const cumulo_vdb_grid* grid, int32_t component, cumulo_vdb_grid** out,
                                  cumulo_vdb_status* status);
int32_t cumulo_vdb_grid_merge(const cumulo_vdb_grid* x, const cumulo_vdb_grid* y, const cumulo_vdb_grid* z,
                              cumulo_vdb_grid** out, cumulo_vdb_status* status);
/* Non-finite values become zero, and negative ones too where `negative` is set; `changed` counts
 * them (voxels and tiles). */
int32_t cumulo_vdb_grid_repair(cumulo_vdb_grid* grid, int32_t negative, uint64_t* changed, cumulo_vdb_status* status);

#ifdef __cplusplus
}
#endif
#endif
