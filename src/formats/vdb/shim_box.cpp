// Resampling by a box filter: a new voxel is the mean over its cell, so that the sum of value times volume is kept.
#include "shim.hpp"

#include <openvdb/tools/Prune.h>
#include <tbb/parallel_for.h>

#include <array>
#include <map>
#include <type_traits>
#include <vector>

using namespace openvdb;
using cumulo::guarded;

namespace {

constexpr int EDGE = 8;
// Share of a voxel below which an overlap is rounding.
constexpr double LEAST = 1e-9;

// Part of the old grid that a new leaf meets: a leaf, or a tile of one value.
template <typename LeafT, typename Sum> struct Source {
    Coord low;
    int dim;
    const LeafT* leaf;
    Sum value; // of a tile, less the background
    bool active;
};

// Length that the cells `from` to `until` of the old grid (inclusive) have in cell `to` of the new one, whose edge is 1.
double overlap(double scale, int from, int until, int to) {
    const double low = std::max((from - 0.5) * scale, to - 0.5);
    const double high = std::min((until + 0.5) * scale, to + 0.5);
    return std::max(high - low, 0.0);
}

// Cells of a new leaf along one axis that a run of old cells meets, with the lengths that they have in common.
struct Run {
    int first = 0, last = -1;
    std::array<double, EDGE> length{};
    Run(double scale, int from, int until, int leaf) {
        for (int j = 0; j < EDGE; ++j) {
            length[j] = overlap(scale, from, until, leaf + j);
            if (length[j] <= LEAST * std::min(scale, 1.0)) continue;
            if (last < 0) first = j;
            last = j;
        }
    }
};

template <typename Sum> struct Cells {
    std::vector<Sum> sum = std::vector<Sum>(EDGE * EDGE * EDGE, Sum(0.0));
    std::vector<bool> active = std::vector<bool>(EDGE * EDGE * EDGE, false);
    void add(const Run& x, const Run& y, const Run& z, const Sum& value, bool on) {
        for (int i = x.first; i <= x.last; ++i) {
            for (int j = y.first; j <= y.last; ++j) {
                for (int k = z.first; k <= z.last; ++k) {
                    const int at = (i * EDGE + j) * EDGE + k;
                    sum[at] += value * (x.length[i] * y.length[j] * z.length[k]);
                    active[at] = active[at] || on;
                }
            }
        }
    }
};

int leaf_of(double cell) { return int(std::floor((cell + 0.5) / EDGE)) * EDGE; }

template <typename GridT> typename GridT::Ptr resampled(const GridT& in, const double* matrix, const double* scale) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using V = typename GridT::ValueType;
    using Sum = std::conditional_t<VecTraits<V>::IsVec, Vec3d, double>;
    using Part = Source<LeafT, Sum>;
    const Sum background = Sum(in.background());
    // New leaves with what they meet, in the order of the tree.
    std::map<Coord, std::vector<Part>> reached;
    const auto reach = [&](const Part& part) {
        Coord low, high;
        for (int a = 0; a < 3; ++a) {
            low[a] = leaf_of((part.low[a] - 0.5) * scale[a]);
            high[a] = leaf_of((part.low[a] + part.dim - 0.5) * scale[a]);
        }
        for (int x = low[0]; x <= high[0]; x += EDGE) {
            for (int y = low[1]; y <= high[1]; y += EDGE) {
                for (int z = low[2]; z <= high[2]; z += EDGE) reached[Coord(x, y, z)].push_back(part);
            }
        }
    };
    for (auto leaf = in.tree().cbeginLeaf(); leaf; ++leaf) reach({leaf->origin(), EDGE, &*leaf, Sum(0.0), false});
    auto tile = in.tree().cbeginValueAll();
    tile.setMaxDepth(GridT::TreeType::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        if (!tile.isValueOn() && *tile == in.background()) continue;
        const CoordBBox box = tile.getBoundingBox();
        reach({box.min(), box.max()[0] - box.min()[0] + 1, nullptr, Sum(*tile) - background, tile.isValueOn()});
    }
    std::vector<const std::pair<const Coord, std::vector<Part>>*> jobs;
    for (const auto& job : reached) jobs.push_back(&job);
    std::vector<std::unique_ptr<LeafT>> leaves(jobs.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, jobs.size()), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t n = range.begin(); n != range.end(); ++n) {
            const Coord& at = jobs[n]->first;
            Cells<Sum> cells;
            for (const Part& part : jobs[n]->second) {
                const auto run = [&](int axis, int from, int until) { return Run(scale[axis], from, until, at[axis]); };
                const Coord& low = part.low;
                if (!part.leaf) {
                    const int end = part.dim - 1;
                    cells.add(run(0, low[0], low[0] + end), run(1, low[1], low[1] + end), run(2, low[2], low[2] + end),
                              part.value, part.active);
                    continue;
                }
                std::vector<Run> runs[3];
                for (int a = 0; a < 3; ++a) {
                    for (int i = 0; i < EDGE; ++i) runs[a].push_back(run(a, low[a] + i, low[a] + i));
                }
                for (Index i = 0; i < LeafT::SIZE; ++i) {
                    const V value = part.leaf->getValue(i);
                    const bool on = part.leaf->isValueOn(i);
                    if (!on && value == in.background()) continue;
                    cells.add(runs[0][i >> 6], runs[1][i >> 3 & 7], runs[2][i & 7], Sum(value) - background, on);
                }
            }
            auto leaf = std::make_unique<LeafT>(at, in.background());
            for (Index i = 0; i < LeafT::SIZE; ++i) {
                leaf->setValueOnly(i, V(cells.sum[i] + background));
                leaf->setActiveState(i, cells.active[i]);
            }
            leaves[n] = std::move(leaf);
        }
    });
    typename GridT::Ptr out = GridT::create(in.background());
    tree::ValueAccessor<typename GridT::TreeType> accessor(out->tree());
    for (auto& leaf : leaves) accessor.addLeaf(leaf.release());
    tools::prune(out->tree());
    static_cast<MetaMap&>(*out) = static_cast<const MetaMap&>(in);
    out->setTransform(cumulo::linear_transform(matrix));
    return out;
}

} // namespace

extern "C" int32_t cumulo_vdb_grid_resample_box(cumulo_vdb_grid* handle, const double* matrix, const double* scale,
                                                cumulo_vdb_status* status) {
    return guarded(status, [&] {
        GridBase::Ptr made;
        handle->grid->apply<TypeList<FloatGrid, DoubleGrid, Vec3SGrid, Vec3DGrid>>(
            [&](const auto& grid) { made = resampled(grid, matrix, scale); });
        if (!made) {
            throw cumulo::Unsupported("grids of type " + handle->grid->type() +
                                      " cannot be resampled (only float, double, vec3s and vec3d can be averaged)");
        }
        handle->grid = made;
    });
}
