// Grids: what they are, their leaves and tiles out, and new ones in.
#include "shim.hpp"

#include <openvdb/tools/Count.h>
#include <tbb/parallel_for.h>
#include <type_traits>
#include <utility>
#include <vector>

using namespace openvdb;
using cumulo::Components;
using cumulo::copy_leaf;
using cumulo::guarded;

namespace {

template <typename GridT>
typename GridT::Ptr build(const float* background, const int32_t (*origins)[3], const float* const* values,
                          const uint64_t* const* active, size_t leaf_count, const cumulo_vdb_tile* tiles,
                          size_t tile_count) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using V = typename GridT::ValueType;
    using C = Components<V>;
    auto grid = GridT::create(C::make(background));
    auto& tree = grid->tree();
    for (size_t i = 0; i < tile_count; ++i) {
        const auto& t = tiles[i];
        const Index level = t.dim == 8 ? 1 : t.dim == 128 ? 2 : t.dim == 4096 ? 3 : 0;
        if (level == 0) throw cumulo::Unsupported("a tile's edge must be 8, 128 or 4096 voxels");
        tree.addTile(level, Coord(t.origin[0], t.origin[1], t.origin[2]), C::make(t.value), t.active != 0);
    }
    std::vector<std::unique_ptr<LeafT>> leaves(leaf_count);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, leaf_count, 64), [&](const tbb::blocked_range<size_t>& r) {
        for (size_t i = r.begin(); i != r.end(); ++i) {
            const Coord origin(origins[i][0], origins[i][1], origins[i][2]);
            std::unique_ptr<LeafT> leaf;
            if (values) {
                leaf = std::make_unique<LeafT>(origin);
                V* out = leaf->buffer().data();
                for (Index v = 0; v < LeafT::SIZE; ++v) out[v] = C::make(values[i] + size_t(v) * C::count);
            } else {
                leaf = std::make_unique<LeafT>(PartialCreate(), origin);
            }
            auto mask = leaf->getValueMask();
            for (Index w = 0; w < 8; ++w) mask.template getWord<uint64_t>(w) = active[i][w];
            leaf->setValueMask(mask);
            leaves[i] = std::move(leaf);
        }
    });
    tree::ValueAccessor<typename GridT::TreeType> accessor(tree);
    for (auto& leaf : leaves) accessor.addLeaf(leaf.release());
    return grid;
}

struct Description {
    cumulo_vdb_info* out;
    template <typename GridT> void operator()(const GridT& grid) const {
        using C = Components<typename GridT::ValueType>;
        out->components = C::count;
        C::put(grid.background(), out->background);
        out->active_tiles = tools::countActiveTiles(grid.tree());
    }
};

} // namespace

struct cumulo_vdb_leaves {
    GridBase::ConstPtr keep;
    std::vector<const void*> leaves;
    int32_t components = 0;
    void (*copy)(const void*, int32_t*, float*, uint64_t*) = nullptr;
};

extern "C" {

void cumulo_vdb_grid_free(cumulo_vdb_grid* grid) {
    cumulo_vdb_status ignored;
    guarded(&ignored, [&] { delete grid; });
}

int32_t cumulo_vdb_grid_info(const cumulo_vdb_grid* handle, cumulo_vdb_info* out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const GridBase& grid = *handle->grid;
        *out = cumulo_vdb_info{};
        cumulo::set_text(out->value_type, grid.valueType().c_str());
        cumulo::set_text(out->grid_type, grid.type().c_str());
        cumulo::set_text(out->map_type, grid.transform().mapType().c_str());
        switch (grid.getGridClass()) {
        case GRID_LEVEL_SET: out->grid_class = 1; break;
        case GRID_FOG_VOLUME: out->grid_class = 2; break;
        case GRID_STAGGERED: out->grid_class = 3; break;
        default: out->grid_class = 0;
        }
        out->saved_as_half = grid.saveFloatAsHalf();
        out->linear = grid.transform().isLinear();
        if (out->linear) {
            // Row by row, and not by `getAffineMap`: that refuses voxels of 1e-5 which other maps hold.
            const math::MapBase& map = *grid.transform().baseMap();
            const Vec3d rows[4] = {map.applyJacobian(Vec3d(1, 0, 0)), map.applyJacobian(Vec3d(0, 1, 0)),
                                   map.applyJacobian(Vec3d(0, 0, 1)), map.applyMap(Vec3d(0, 0, 0))};
            for (int i = 0; i < 16; ++i) out->matrix[i] = i % 4 < 3 ? rows[i / 4][i % 4] : (i == 15 ? 1.0 : 0.0);
        }
        out->active_voxels = grid.activeVoxelCount();
        const CoordBBox box = grid.evalActiveVoxelBoundingBox();
        for (int c = 0; c < 3; ++c) {
            out->box_min[c] = box.min()[c];
            out->box_max[c] = box.max()[c];
        }
        out->leaf_count = grid.baseTree().leafCount();
        out->memory = grid.memUsage();
        grid.apply<cumulo::ReadableGrids>(Description{out});
    });
}

int32_t cumulo_vdb_grid_meta(cumulo_vdb_grid* grid, cumulo_vdb_meta** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto meta = std::make_unique<cumulo_vdb_meta>();
        meta->map = grid->grid;
        *out = meta.release();
    });
}

int32_t cumulo_vdb_grid_mend_meta(cumulo_vdb_grid* handle, uint64_t* dropped, char (*first)[64],
                                  cumulo_vdb_status* status) {
    return guarded(status, [&] {
        using Text = StringMetadata;
        const std::pair<const char*, Name> expected[] = {
            {GridBase::META_GRID_CLASS, Text::staticTypeName()},
            {GridBase::META_GRID_CREATOR, Text::staticTypeName()},
            {GridBase::META_GRID_NAME, Text::staticTypeName()},
            {GridBase::META_SAVE_HALF_FLOAT, BoolMetadata::staticTypeName()},
            {GridBase::META_IS_LOCAL_SPACE, BoolMetadata::staticTypeName()},
            {GridBase::META_VECTOR_TYPE, Text::staticTypeName()},
            {GridBase::META_FILE_BBOX_MIN, Vec3IMetadata::staticTypeName()},
            {GridBase::META_FILE_BBOX_MAX, Vec3IMetadata::staticTypeName()},
            {GridBase::META_FILE_COMPRESSION, Text::staticTypeName()},
            {GridBase::META_FILE_MEM_BYTES, Int64Metadata::staticTypeName()},
            {GridBase::META_FILE_VOXEL_COUNT, Int64Metadata::staticTypeName()},
        };
        *dropped = 0;
        cumulo::set_text(*first, "");
        for (const auto& [name, type] : expected) {
            const Metadata::ConstPtr found = std::as_const(*handle->grid)[name];
            if (!found || found->typeName() == type) continue;
            handle->grid->removeMeta(name);
            if ((*dropped)++ == 0) cumulo::set_text(*first, name);
        }
    });
}

int32_t cumulo_vdb_leaves_new(const cumulo_vdb_grid* handle, cumulo_vdb_leaves** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto result = std::make_unique<cumulo_vdb_leaves>();
        result->keep = handle->grid;
        const bool known = handle->grid->apply<cumulo::ReadableGrids>([&](const auto& grid) {
            using LeafT = typename std::decay_t<decltype(grid)>::TreeType::LeafNodeType;
            std::vector<const LeafT*> found;
            grid.tree().getNodes(found);
            std::sort(found.begin(), found.end(),
                      [](const LeafT* a, const LeafT* b) { return a->origin() < b->origin(); });
            result->leaves.assign(found.begin(), found.end());
            result->components = Components<typename LeafT::ValueType>::count;
            result->copy = &copy_leaf<LeafT>;
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " have no values to read");
        *out = result.release();
    });
}

void cumulo_vdb_leaves_free(cumulo_vdb_leaves* leaves) {
    cumulo_vdb_status ignored;
    guarded(&ignored, [&] { delete leaves; });
}

int32_t cumulo_vdb_leaves_count(const cumulo_vdb_leaves* leaves, size_t* count, int32_t* components,
                                cumulo_vdb_status* status) {
    return guarded(status, [&] {
        *count = leaves->leaves.size();
        *components = leaves->components;
    });
}

int32_t cumulo_vdb_leaves_copy(const cumulo_vdb_leaves* leaves, size_t index, int32_t* origin, float* values,
                               size_t capacity, uint64_t* active, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        if (index >= leaves->leaves.size()) throw std::out_of_range("leaf index");
        if (capacity < size_t(512) * size_t(leaves->components)) throw std::out_of_range("room for a leaf's values");
        leaves->copy(leaves->leaves[index], origin, values, active);
    });
}

int32_t cumulo_vdb_tiles(const cumulo_vdb_grid* handle, cumulo_vdb_tile* tiles, size_t capacity, size_t* count,
                         cumulo_vdb_status* status) {
    return guarded(status, [&] {
        *count = 0;
        const bool known = handle->grid->apply<cumulo::ReadableGrids>([&](const auto& grid) {
            using GridT = std::decay_t<decltype(grid)>;
            using C = Components<typename GridT::ValueType>;
            const auto background = grid.background();
            auto it = grid.tree().cbeginValueAll();
            it.setMaxDepth(GridT::TreeType::ValueAllCIter::LEAF_DEPTH - 1);
            for (; it; ++it) {
                if (!it.isValueOn() && it.getValue() == background) continue;
                if (*count < capacity) {
                    const CoordBBox box = it.getBoundingBox();
                    cumulo_vdb_tile& t = tiles[*count];
                    t = cumulo_vdb_tile{};
                    for (int c = 0; c < 3; ++c) t.origin[c] = box.min()[c];
                    t.dim = box.max()[0] - box.min()[0] + 1;
                    t.active = it.isValueOn();
                    C::put(it.getValue(), t.value);
                }
                ++*count;
            }
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " have no values to read");
    });
}

int32_t cumulo_vdb_grid_same(const cumulo_vdb_grid* a, const cumulo_vdb_grid* b, int32_t* same,
                             cumulo_vdb_status* status) {
    return guarded(status, [&] {
        *same = 0;
        a->grid->apply<cumulo::ReadableGrids>([&](const auto& left) {
            using GridT = std::decay_t<decltype(left)>;
            const auto right = gridConstPtrCast<GridT>(GridBase::ConstPtr(b->grid));
            if (!right || left.background() != right->background()) return;
            if (!left.tree().hasSameTopology(right->tree())) return;
            // Of one topology: nodes and values come in the same order.
            auto i = left.cbeginValueAll();
            auto j = right->cbeginValueAll();
            for (; i && j; ++i, ++j) {
                if (*i != *j || i.isValueOn() != j.isValueOn()) return;
            }
            *same = !i && !j;
        });
    });
}

int32_t cumulo_vdb_grid_new(int32_t components, const float* background, const int32_t (*origins)[3],
                            const float* const* values, const uint64_t* const* active, size_t leaf_count,
                            const cumulo_vdb_tile* tiles, size_t tile_count, cumulo_vdb_grid** out,
                            cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto handle = std::make_unique<cumulo_vdb_grid>();
        if (components == 1) {
            handle->grid = build<FloatGrid>(background, origins, values, active, leaf_count, tiles, tile_count);
        } else {
            handle->grid = build<Vec3SGrid>(background, origins, values, active, leaf_count, tiles, tile_count);
        }
        *out = handle.release();
    });
}

int32_t cumulo_vdb_grid_set_name(cumulo_vdb_grid* grid, const char* name, cumulo_vdb_status* status) {
    return guarded(status, [&] { grid->grid->setName(name); });
}

int32_t cumulo_vdb_grid_set_class(cumulo_vdb_grid* grid, int32_t grid_class, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        static const GridClass classes[] = {GRID_UNKNOWN, GRID_LEVEL_SET, GRID_FOG_VOLUME, GRID_STAGGERED};
        if (grid_class < 0 || grid_class > 3) throw std::out_of_range("grid class");
        grid->grid->setGridClass(classes[grid_class]);
    });
}

int32_t cumulo_vdb_grid_set_half(cumulo_vdb_grid* grid, int32_t half, cumulo_vdb_status* status) {
    return guarded(status, [&] { grid->grid->setSaveFloatAsHalf(half != 0); });
}

int32_t cumulo_vdb_grid_set_matrix(cumulo_vdb_grid* grid, const double* matrix, cumulo_vdb_status* status) {
    return guarded(status, [&] { grid->grid->setTransform(cumulo::linear_transform(matrix)); });
}

} // extern "C"
