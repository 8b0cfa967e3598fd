// What the parts of the shim share: the handles and the wall that no exception passes.
#pragma once

#include "shim.h"

#include <openvdb/openvdb.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <istream>
#include <memory>
#include <new>
#include <sstream>
#include <stdexcept>
#include <streambuf>
#include <string>
#include <system_error>
#include <type_traits>

struct cumulo_vdb_grid {
    openvdb::GridBase::Ptr grid;
};

struct cumulo_vdb_meta {
    openvdb::MetaMap::Ptr map; // of a grid: shares the grid's ownership
    // The entry after the one that was asked for last: entries are asked for in order.
    openvdb::MetaMap::MetaIterator at = {};
    size_t next = SIZE_MAX;
};

namespace cumulo {

// Grids whose values we read, by the number of components.
using ScalarGrids = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid,
                                      openvdb::BoolGrid, openvdb::MaskGrid>;
using VectorGrids = openvdb::TypeList<openvdb::Vec3SGrid, openvdb::Vec3DGrid, openvdb::Vec3IGrid>;
using ReadableGrids = ScalarGrids::Append<VectorGrids>;

// Values as floats, component by component.
template <typename T, typename = void> struct Components {
    static constexpr int count = 1;
    static void put(const T& v, float* out) { out[0] = float(v); }
    static void put(const T& v, double* out) { out[0] = double(v); }
    static T make(const float* v) { return T(v[0]); }
};
template <typename T> struct Components<T, std::enable_if_t<openvdb::VecTraits<T>::IsVec>> {
    static constexpr int count = 3;
    template <typename F> static void put(const T& v, F* out) {
        for (int c = 0; c < 3; ++c) out[c] = F(v[c]);
    }
    static T make(const float* v) { return T(v[0], v[1], v[2]); }
};

template <typename LeafT> void copy_leaf(const void* pointer, int32_t* origin, float* values, uint64_t* active) {
    using V = typename LeafT::ValueType;
    using C = Components<V>;
    const LeafT& leaf = *static_cast<const LeafT*>(pointer);
    for (int c = 0; c < 3; ++c) origin[c] = leaf.origin()[c];
    for (openvdb::Index w = 0; w < 8; ++w) active[w] = leaf.valueMask().template getWord<uint64_t>(w);
    if constexpr (std::is_same_v<V, float>) {
        std::memcpy(values, leaf.buffer().data(), sizeof(float) * LeafT::SIZE);
    } else {
        for (openvdb::Index i = 0; i < LeafT::SIZE; ++i) C::put(leaf.getValue(i), values + size_t(i) * C::count);
    }
}

// The request makes no sense for this grid: the caller's fault, not the library's.
struct Unsupported : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// Bytes in memory; positions count from their first.
class Bytes : public std::streambuf {
public:
    Bytes(const uint8_t* bytes, size_t length) {
        // The get area is never written to.
        char* const first = const_cast<char*>(reinterpret_cast<const char*>(bytes));
        setg(first, first, first + length);
    }

protected:
    pos_type seekoff(off_type offset, std::ios_base::seekdir way, std::ios_base::openmode) override {
        const off_type now = gptr() - eback();
        const off_type size = egptr() - eback();
        const off_type base = way == std::ios_base::beg ? 0 : way == std::ios_base::cur ? now : size;
        const off_type to = base + offset;
        if (to < 0 || to > size) return pos_type(off_type(-1));
        setg(eback(), eback() + to, egptr());
        return pos_type(to);
    }
    pos_type seekpos(pos_type to, std::ios_base::openmode which) override {
        return seekoff(off_type(to), std::ios_base::beg, which);
    }
};

// A stream over bytes that throws where OpenVDB would go on with what it did not get.
struct Part {
    Part(const uint8_t* bytes, size_t length) : buffer(bytes, length), stream(&buffer) {
        stream.exceptions(std::ios_base::badbit | std::ios_base::failbit | std::ios_base::eofbit);
    }
    Bytes buffer;
    std::istream stream;
};

template <size_t N> void set_text(char (&out)[N], const char* text) {
    std::strncpy(out, text ? text : "", N - 1);
    out[N - 1] = 0;
}

// A linear transform with this row-vector matrix. OpenVDB's constructors refuse determinants below 3e-15, which voxels of
// 1e-5 have, and so does every copy of a transform, save that of a uniform scale: that one is read as from a file.
inline openvdb::math::Transform::Ptr linear_transform(const double* rows) {
    using namespace openvdb;
    const math::Mat4d matrix(rows);
    if (std::abs(matrix.getMat3().det()) >= 3.0 * math::Tolerance<double>::value()) {
        return math::Transform::createLinearTransform(matrix);
    }
    const Vec3d scale(rows[0], rows[5], rows[10]);
    math::Mat4d uniform = math::Mat4d::identity();
    for (int i = 0; i < 3; ++i) uniform(i, i) = rows[0];
    if (!(matrix == uniform) || rows[0] == 0.0) {
        throw Unsupported("voxels as small as these must be cubes along the axes, with voxel (0, 0, 0) at the origin");
    }
    const Vec3d inverse = 1.0 / scale;
    std::stringstream stored(std::ios_base::in | std::ios_base::out | std::ios_base::binary);
    scale.write(stored);
    Vec3d(std::abs(scale[0]), std::abs(scale[1]), std::abs(scale[2])).write(stored);
    inverse.write(stored);
    Vec3d(inverse * inverse).write(stored);
    Vec3d(inverse / 2).write(stored);
    const math::MapBase::Ptr map = math::UniformScaleMap::create();
    map->read(stored);
    return std::make_shared<math::Transform>(map);
}

// The exception wall. Every entry that can fail runs its body in here.
template <typename Body> int32_t guarded(cumulo_vdb_status* status, Body&& body) noexcept {
    int32_t code = CUMULO_VDB_OK;
    const char* fixed = "";
    status->os_error = 0;
    try {
        body();
        status->code = CUMULO_VDB_OK;
        status->message[0] = 0;
        return CUMULO_VDB_OK;
    } catch (const Unsupported& e) {
        code = CUMULO_VDB_UNSUPPORTED;
        set_text(status->message, e.what());
        fixed = nullptr;
    } catch (const std::ios_base::failure&) {
        // A stream over bytes: no error of the system, which its type derives from.
        code = CUMULO_VDB_FAILED;
        fixed = "the bytes end before what is read from them, or contradict it";
    } catch (const std::system_error& e) {
        code = CUMULO_VDB_IO;
        status->os_error = e.code().value();
        set_text(status->message, e.what());
        fixed = nullptr;
    } catch (const std::bad_alloc&) {
        code = CUMULO_VDB_OUT_OF_MEMORY;
        fixed = "out of memory";
    } catch (const std::exception& e) {
        code = CUMULO_VDB_FAILED;
        set_text(status->message, e.what());
        fixed = nullptr;
    } catch (...) {
        code = CUMULO_VDB_UNKNOWN;
        fixed = "an exception of unknown type";
    }
    if (fixed) set_text(status->message, fixed);
    status->code = code;
    return code;
}

} // namespace cumulo
