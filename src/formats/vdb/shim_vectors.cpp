// Vectors: turned, taken apart into scalars, and put together from them.
#include "shim.hpp"

#include <openvdb/tools/ValueTransformer.h>
#include <openvdb/tree/LeafManager.h>

#include <type_traits>

using namespace openvdb;
using cumulo::guarded;

namespace {

// Metadata of a grid whose values were those of `from` in another type.
void inherit(GridBase& to, const GridBase& from) {
    static_cast<MetaMap&>(to) = static_cast<const MetaMap&>(from);
    for (const char* entry : {"value_type", GridBase::META_VECTOR_TYPE, GridBase::META_GRID_CLASS}) to.removeMeta(entry);
}

template <typename TreeT, typename Value> void for_each_tile(const TreeT& tree, Value&& value) {
    auto it = tree.cbeginValueAll();
    it.setMaxDepth(TreeT::ValueAllCIter::LEAF_DEPTH - 1);
    for (; it; ++it) {
        const CoordBBox box = it.getBoundingBox();
        const Index dim = Index(box.max()[0] - box.min()[0] + 1);
        value(dim == 8 ? 1 : dim == 128 ? 2 : 3, box.min(), *it, it.isValueOn());
    }
}

template <typename ScalarGrid, typename VectorGrid>
GridBase::Ptr component(const VectorGrid& in, int c) {
    using TreeT = typename ScalarGrid::TreeType;
    using S = typename ScalarGrid::ValueType;
    auto tree = std::make_shared<TreeT>(in.tree(), S(in.background()[c]), TopologyCopy());
    for_each_tile(in.tree(), [&](Index level, const Coord& at, const auto& value, bool active) {
        tree->addTile(level, at, S(value[c]), active);
    });
    tree::LeafManager<TreeT> leaves(*tree);
    leaves.foreach ([&](auto& leaf, size_t) {
        const auto* source = in.tree().probeConstLeaf(leaf.origin());
        if (!source) return;
        for (Index i = 0; i < TreeT::LeafNodeType::SIZE; ++i) leaf.setValueOnly(i, S(source->getValue(i)[c]));
    });
    auto out = ScalarGrid::create(tree);
    inherit(*out, in);
    out->setTransform(in.transform().copy());
    return out;
}

template <typename VectorGrid, typename ScalarGrid> GridBase::Ptr merged(const ScalarGrid* const (&parts)[3]) {
    using TreeT = typename VectorGrid::TreeType;
    using V = typename VectorGrid::ValueType;
    using Accessor = tree::ValueAccessor<const typename ScalarGrid::TreeType>;
    const V background(parts[0]->background(), parts[1]->background(), parts[2]->background());
    auto tree = std::make_shared<TreeT>(parts[0]->tree(), background, TopologyCopy());
    tree->topologyUnion(parts[1]->tree());
    tree->topologyUnion(parts[2]->tree());
    // Where the union has a tile, each part is constant.
    Accessor x(parts[0]->tree()), y(parts[1]->tree()), z(parts[2]->tree());
    auto it = tree->beginValueAll();
    it.setMaxDepth(TreeT::ValueAllIter::LEAF_DEPTH - 1);
    for (; it; ++it) {
        const Coord at = it.getBoundingBox().min();
        it.setValue(V(x.getValue(at), y.getValue(at), z.getValue(at)));
    }
    tree::LeafManager<TreeT> leaves(*tree);
    leaves.foreach ([&](auto& leaf, size_t) {
        Accessor x(parts[0]->tree()), y(parts[1]->tree()), z(parts[2]->tree());
        for (Index i = 0; i < TreeT::LeafNodeType::SIZE; ++i) {
            const Coord at = leaf.offsetToGlobalCoord(i);
            leaf.setValueOnly(i, V(x.getValue(at), y.getValue(at), z.getValue(at)));
        }
    });
    auto out = VectorGrid::create(tree);
    inherit(*out, *parts[0]);
    out->setTransform(parts[0]->transform().copy());
    return out;
}

} // namespace

extern "C" {

int32_t cumulo_vdb_grid_turn_vectors(cumulo_vdb_grid* handle, const double* rows, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const bool known = handle->grid->apply<cumulo::VectorGrids>([&](auto& grid) {
            using V = typename std::decay_t<decltype(grid)>::ValueType;
            using T = typename V::value_type;
            const auto turned = [rows](const V& v) {
                const auto row = [&](int r) {
                    return T(rows[3 * r] * v[0] + rows[3 * r + 1] * v[1] + rows[3 * r + 2] * v[2]);
                };
                return V(row(0), row(1), row(2));
            };
            tools::foreach (grid.beginValueAll(), [&](const auto& it) { it.setValue(turned(*it)); });
            grid.tree().root().setBackground(turned(grid.background()), /*updateChildNodes=*/false);
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " hold no vectors to turn");
    });
}

int32_t cumulo_vdb_grid_component(const cumulo_vdb_grid* handle, int32_t c, cumulo_vdb_grid** out,
                                  cumulo_vdb_status* status) {
    return guarded(status, [&] {
        if (c < 0 || c > 2) throw std::out_of_range("component");
        auto made = std::make_unique<cumulo_vdb_grid>();
        const GridBase& grid = *handle->grid;
        if (grid.isType<Vec3SGrid>()) made->grid = component<FloatGrid>(static_cast<const Vec3SGrid&>(grid), c);
        else if (grid.isType<Vec3DGrid>()) made->grid = component<DoubleGrid>(static_cast<const Vec3DGrid&>(grid), c);
        else if (grid.isType<Vec3IGrid>()) made->grid = component<Int32Grid>(static_cast<const Vec3IGrid&>(grid), c);
        else throw cumulo::Unsupported("grids of type " + grid.type() + " hold no vectors to split");
        *out = made.release();
    });
}

int32_t cumulo_vdb_grid_merge(const cumulo_vdb_grid* x, const cumulo_vdb_grid* y, const cumulo_vdb_grid* z,
                              cumulo_vdb_grid** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto made = std::make_unique<cumulo_vdb_grid>();
        x->grid->apply<TypeList<FloatGrid, DoubleGrid, Int32Grid>>([&](const auto& first) {
            using GridT = std::decay_t<decltype(first)>;
            using VectorGrid = std::conditional_t<std::is_same_v<GridT, FloatGrid>, Vec3SGrid,
                                                  std::conditional_t<std::is_same_v<GridT, DoubleGrid>, Vec3DGrid, Vec3IGrid>>;
            if (!y->grid->isType<GridT>() || !z->grid->isType<GridT>()) return;
            const GridT* const parts[3] = {&first, static_cast<const GridT*>(y->grid.get()),
                                           static_cast<const GridT*>(z->grid.get())};
            made->grid = merged<VectorGrid>(parts);
        });
        if (!made->grid) {
            throw cumulo::Unsupported("grids of type " + x->grid->type() + ", " + y->grid->type() + " and " +
                                      z->grid->type() + " make no vectors (three float, double or int32 do)");
        }
        *out = made.release();
    });
}

} // extern "C"
