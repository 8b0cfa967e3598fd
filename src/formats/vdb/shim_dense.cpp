// Boxes of voxels in double precision: grids of several types made from dense values and read as such.
#include "shim.hpp"

#include <limits>
#include <type_traits>

using namespace openvdb;
using cumulo::guarded;

namespace {

using WritableGrids = TypeList<FloatGrid, DoubleGrid, Int32Grid, Vec3SGrid>;

template <typename T, typename = void> struct Numbers {
    static constexpr int count = 1;
    static void put(const T& v, double* out) { out[0] = double(v); }
    static T make(const double* v) { return T(v[0]); }
};
template <typename T> struct Numbers<T, std::enable_if_t<VecTraits<T>::IsVec>> {
    static constexpr int count = 3;
    static void put(const T& v, double* out) {
        for (int c = 0; c < 3; ++c) out[c] = double(v[c]);
    }
    static T make(const double* v) {
        using E = typename VecTraits<T>::ElementType;
        return T(E(v[0]), E(v[1]), E(v[2]));
    }
};

// A box with the places of its voxels in an array.
struct Dense {
    CoordBBox box;
    int64_t strides[3];

    Dense(const int32_t* low, const int32_t* high, const int64_t* steps)
        : box(Coord(low[0], low[1], low[2]), Coord(high[0], high[1], high[2])), strides{steps[0], steps[1], steps[2]} {}

    // Throws unless every voxel has a place among `room` numbers.
    void check(size_t room, int components) const {
        if (box.empty()) throw std::out_of_range("an empty box");
        __int128 last = components;
        for (int a = 0; a < 3; ++a) {
            if (strides[a] < components) throw std::out_of_range("a stride");
            last += __int128(strides[a]) * (int64_t(box.max()[a]) - box.min()[a]);
        }
        if (last > __int128(room)) throw std::out_of_range("room for the box's values");
    }
    size_t at(const Coord& c) const {
        int64_t place = 0;
        for (int a = 0; a < 3; ++a) place += strides[a] * (int64_t(c[a]) - box.min()[a]);
        return size_t(place);
    }
    // Calls `body` with every part of the box that lies in one leaf.
    template <typename Body> void parts(Body&& body) const {
        const auto low = [](int32_t v) { return v & ~7; };
        for (int64_t x = low(box.min()[0]); x <= box.max()[0]; x += 8) {
            for (int64_t y = low(box.min()[1]); y <= box.max()[1]; y += 8) {
                for (int64_t z = low(box.min()[2]); z <= box.max()[2]; z += 8) {
                    const Coord origin{int32_t(x), int32_t(y), int32_t(z)};
                    CoordBBox part(origin, origin.offsetBy(7));
                    part.intersect(box);
                    if (!body(part)) return;
                }
            }
        }
    }
    template <typename Body> static void voxels(const CoordBBox& part, Body&& body) {
        for (int x = part.min()[0]; x <= part.max()[0]; ++x) {
            for (int y = part.min()[1]; y <= part.max()[1]; ++y) {
                for (int z = part.min()[2]; z <= part.max()[2]; ++z) body(Coord(x, y, z));
            }
        }
    }
};

} // namespace

extern "C" {

int32_t cumulo_vdb_grid_empty(int32_t kind, cumulo_vdb_grid** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto handle = std::make_unique<cumulo_vdb_grid>();
        switch (kind) {
        case 0: handle->grid = FloatGrid::create(); break;
        case 1: handle->grid = DoubleGrid::create(); break;
        case 2: handle->grid = Int32Grid::create(); break;
        case 3: handle->grid = Vec3SGrid::create(); break;
        default: throw std::out_of_range("kind of grid");
        }
        *out = handle.release();
    });
}

int32_t cumulo_vdb_grid_read_box(const cumulo_vdb_grid* handle, const int32_t* low, const int32_t* high,
                                 const int64_t* strides, double* out, size_t room, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const Dense dense(low, high, strides);
        const bool known = handle->grid->apply<cumulo::ReadableGrids>([&](const auto& grid) {
            using GridT = std::decay_t<decltype(grid)>;
            using N = Numbers<typename GridT::ValueType>;
            dense.check(room, N::count);
            tree::ValueAccessor<const typename GridT::TreeType> accessor(grid.tree());
            dense.parts([&](const CoordBBox& part) {
                if (const auto* leaf = accessor.probeConstLeaf(part.min())) {
                    Dense::voxels(part, [&](const Coord& c) { N::put(leaf->getValue(c), out + dense.at(c)); });
                } else {
                    // A tile, or the background: constant in the part.
                    const auto value = accessor.getValue(part.min());
                    Dense::voxels(part, [&](const Coord& c) { N::put(value, out + dense.at(c)); });
                }
                return true;
            });
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " have no values to read");
    });
}

int32_t cumulo_vdb_grid_write_box(cumulo_vdb_grid* handle, const int32_t* low, const int32_t* high,
                                  const int64_t* strides, const double* values, size_t room, uint64_t most,
                                  uint64_t* made, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        *made = 0;
        const Dense dense(low, high, strides);
        const bool known = handle->grid->apply<WritableGrids>([&](auto& grid) {
            using GridT = std::decay_t<decltype(grid)>;
            using LeafT = typename GridT::TreeType::LeafNodeType;
            using V = typename GridT::ValueType;
            using N = Numbers<V>;
            dense.check(room, N::count);
            tree::ValueAccessor<typename GridT::TreeType> accessor(grid.tree());
            const V zero = zeroVal<V>();
            dense.parts([&](const CoordBBox& part) {
                bool any = false;
                Dense::voxels(part, [&](const Coord& c) { any = any || !(N::make(values + dense.at(c)) == zero); });
                if (!any) return true;
                LeafT* leaf = accessor.probeLeaf(part.min());
                if (!leaf) {
                    if (*made >= most) {
                        *made = most + 1;
                        return false;
                    }
                    ++*made;
                    leaf = accessor.touchLeaf(part.min());
                }
                Dense::voxels(part, [&](const Coord& c) {
                    const V value = N::make(values + dense.at(c));
                    if (!(value == zero)) leaf->setValueOn(c, value);
                });
                return true;
            });
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " are not made from arrays");
    });
}

int32_t cumulo_vdb_grid_add_tile(cumulo_vdb_grid* handle, const int32_t* origin, int32_t dim, double value,
                                 cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const Index level = dim == 8 ? 1 : dim == 128 ? 2 : dim == 4096 ? 3 : 0;
        if (level == 0) throw cumulo::Unsupported("a tile's edge must be 8, 128 or 4096 voxels");
        const bool known = handle->grid->apply<TypeList<FloatGrid, DoubleGrid, Int32Grid>>([&](auto& grid) {
            using V = typename std::decay_t<decltype(grid)>::ValueType;
            grid.tree().addTile(level, Coord(origin[0], origin[1], origin[2]), V(value), true);
        });
        if (!known) throw cumulo::Unsupported("grids of type " + handle->grid->type() + " are not made from tiles");
    });
}

} // extern "C"
