// Edits of native grids in place: crop, prune, resample, repair.
#include "shim.hpp"

#include <openvdb/tools/GridTransformer.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/ValueTransformer.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <type_traits>

using namespace openvdb;
using cumulo::guarded;

namespace {

using Interpolated = TypeList<FloatGrid, DoubleGrid, Vec3SGrid, Vec3DGrid>;

[[noreturn]] void refuse(const cumulo_vdb_grid* grid, const char* what) {
    throw cumulo::Unsupported("grids of type " + grid->grid->type() + " cannot be " + what);
}

// True if the number was replaced.
template <typename T> bool mend(T& v, bool negative) {
    if (std::isfinite(v) && !(negative && v < T(0))) return false;
    v = T(0);
    return true;
}
template <typename T> bool mend(math::Vec3<T>& v, bool) {
    bool changed = false;
    for (int c = 0; c < 3; ++c) changed |= mend(v[c], false);
    return changed;
}

} // namespace

extern "C" {

int32_t cumulo_vdb_grid_crop(cumulo_vdb_grid* handle, const double* world_min, const double* world_max,
                             cumulo_vdb_status* status) {
    return guarded(status, [&] {
        bool readable = false;
        handle->grid->apply<cumulo::ReadableGrids>([&](const auto&) { readable = true; });
        if (!readable) refuse(handle, "cropped");
        // What `clipGrid` does, save that corners beyond index space do not overflow.
        const BBoxd box = handle->grid->transform().worldToIndex(BBoxd(Vec3d(world_min), Vec3d(world_max)));
        const auto within = [](double v) {
            return int32_t(std::min(std::max(v, double(std::numeric_limits<int32_t>::min())),
                                    double(std::numeric_limits<int32_t>::max())));
        };
        CoordBBox index;
        for (int c = 0; c < 3; ++c) {
            if (std::isnan(box.min()[c]) || std::isnan(box.max()[c])) {
                throw cumulo::Unsupported("the box lies at no place of index space");
            }
            index.min()[c] = within(std::floor(box.min()[c]));
            index.max()[c] = within(std::floor(box.max()[c]));
        }
        handle->grid->clip(index);
    });
}

int32_t cumulo_vdb_grid_prune(cumulo_vdb_grid* handle, double tolerance, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const bool known = handle->grid->apply<cumulo::ReadableGrids>([&](auto& grid) {
            using GridT = std::decay_t<decltype(grid)>;
            using V = typename GridT::ValueType;
            if (grid.getGridClass() == GRID_LEVEL_SET) {
                if constexpr (std::is_floating_point_v<V>) {
                    tools::pruneLevelSet(grid.tree());
                    return;
                }
            }
            if constexpr (std::is_same_v<V, bool> || std::is_same_v<GridT, MaskGrid>) {
                tools::prune(grid.tree());
            } else {
                tools::prune(grid.tree(), V(tolerance));
            }
        });
        if (!known) refuse(handle, "pruned");
    });
}

int32_t cumulo_vdb_grid_resample(cumulo_vdb_grid* handle, const double* matrix, const double* scale,
                                 cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const bool known = handle->grid->apply<Interpolated>([&](const auto& in) {
            using GridT = std::decay_t<decltype(in)>;
            // Not by `copyWithNewTree`: that copies the transform by way of its matrix, which may be too small for it.
            typename GridT::Ptr out = GridT::create(in.background());
            static_cast<MetaMap&>(*out) = static_cast<const MetaMap&>(in);
            out->setTransform(cumulo::linear_transform(matrix));
            math::Mat4d between = math::Mat4d::identity();
            for (int c = 0; c < 3; ++c) between(c, c) = scale[c];
            tools::GridTransformer transformer(between);
            transformer.transformGrid<tools::BoxSampler>(in, *out);
            handle->grid = out;
        });
        if (!known) refuse(handle, "resampled (only float, double, vec3s and vec3d can be interpolated)");
    });
}

int32_t cumulo_vdb_grid_repair(cumulo_vdb_grid* handle, int32_t negative, uint64_t* changed,
                               cumulo_vdb_status* status) {
    return guarded(status, [&] {
        std::atomic<uint64_t> count{0};
        handle->grid->apply<Interpolated>([&](auto& grid) {
            using V = typename std::decay_t<decltype(grid)>::ValueType;
            tools::foreach (grid.beginValueAll(), [&](const auto& it) {
                V value = *it;
                if (mend(value, negative != 0)) {
                    it.setValue(value);
                    count.fetch_add(1, std::memory_order_relaxed);
                }
            });
            V background = grid.background();
            if (mend(background, negative != 0)) {
                grid.tree().root().setBackground(background, /*updateChildNodes=*/false);
                count.fetch_add(1, std::memory_order_relaxed);
            }
        });
        *changed = count.load();
    });
}

} // extern "C"
