// A grid's leaves decoded by several threads. OpenVDB's own readers do all decoding; what this file adds
// is that they start at many places at once, which the caller has found and checked beforehand.
#include "shim.hpp"

#include <openvdb/io/io.h>

#include <cstdlib>
#include <istream>
#include <vector>

using namespace openvdb;
using cumulo::guarded;
using cumulo::Part;

struct cumulo_vdb_loading {
    GridBase::Ptr grid;
    io::StreamMetadata::Ptr meta;
    std::vector<void*> leaves;
    void (*read)(void* leaf, std::istream& stream, bool half) = nullptr;
    void (*copy)(const void* leaf, int32_t* origin, float* values, uint64_t* active) = nullptr;
    void (*release)(void* leaf) = nullptr;
    int components = 0;
};

namespace {

// Bytes that decoding takes beside what it decodes: of all nodes above the leaves, and of a leaf.
constexpr size_t ROOM_OF_NODES = 2 << 20, ROOM_OF_LEAF = 96 << 10;

// Throws if so much memory is not to be had. Blosc writes through the null pointer that an allocation of its own returns.
void need(size_t bytes) {
    void* const room = std::malloc(bytes);
    if (!room) throw std::bad_alloc();
    // Not to be left out by the compiler.
    *static_cast<volatile char*>(room) = 0;
    std::free(room);
}

// Frees the values of a leaf; where they are bits, there is nothing to free.
template <typename LeafT> void release_leaf(void* pointer) {
    using V = typename LeafT::ValueType;
    if constexpr (!std::is_same_v<V, bool> && !std::is_same_v<V, ValueMask>) {
        typename LeafT::Buffer empty(PartialCreate(), zeroVal<V>());
        static_cast<LeafT*>(pointer)->swap(empty);
    }
}

// Decodes leaves from bytes, and calls `each` with the number of every one that is there.
template <typename Each>
void decode(const cumulo_vdb_loading* loading, size_t first, size_t count, const uint8_t* bytes, size_t length, Each&& each) {
    if (first > loading->leaves.size() || count > loading->leaves.size() - first) throw std::out_of_range("leaves");
    Part part(bytes, length);
    // A copy: readers count leaves in it.
    auto meta = std::make_shared<io::StreamMetadata>(*loading->meta);
    io::setStreamMetadataPtr(part.stream, meta);
    const bool half = loading->grid->saveFloatAsHalf();
    for (size_t i = first; i < first + count; ++i) {
        need(ROOM_OF_LEAF);
        loading->read(loading->leaves[i], part.stream, half);
        each(i);
    }
    if (part.stream.tellg() != std::streampos(std::streamoff(length))) {
        throw std::runtime_error("leaves end where they should not");
    }
}

} // namespace

extern "C" {

int32_t cumulo_vdb_load_begin(const cumulo_vdb_layout* layout, cumulo_vdb_loading** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto loading = std::make_unique<cumulo_vdb_loading>();
        loading->grid = GridBase::createGrid(layout->grid_type);
        GridBase& grid = *loading->grid;
        grid.setSaveFloatAsHalf(layout->half != 0);

        need(ROOM_OF_NODES);
        // What `io::Archive::readGrid` does, up to the buffers.
        Part head(layout->bytes, layout->length);
        std::istream& is = head.stream;
        loading->meta = std::make_shared<io::StreamMetadata>();
        // The buffers' copies of the masks are skipped: those of the topology have been checked.
        loading->meta->setSeekable(true);
        loading->meta->setHalfFloat(layout->half != 0);
        io::setStreamMetadataPtr(is, loading->meta);
        io::setVersion(is, VersionId(layout->library[0], layout->library[1]), layout->file_version);
        uint32_t compression = 0;
        is.read(reinterpret_cast<char*>(&compression), sizeof compression);
        io::setDataCompression(is, compression);
        grid.readMeta(is);
        grid.removeMeta(GridBase::META_FILE_DELAYED_LOAD);
        io::setGridClass(is, grid.getGridClass());
        grid.readTransform(is);
        grid.readTopology(is);

        const bool known = grid.apply<cumulo::ReadableGrids>([&](auto& typed) {
            using LeafT = typename std::decay_t<decltype(typed)>::TreeType::LeafNodeType;
            std::vector<LeafT*> found; // depth first: in the order of their buffers
            typed.tree().getNodes(found);
            loading->leaves.assign(found.begin(), found.end());
            loading->copy = &cumulo::copy_leaf<LeafT>;
            loading->release = &release_leaf<LeafT>;
            loading->components = cumulo::Components<typename LeafT::ValueType>::count;
            loading->read = [](void* leaf, std::istream& stream, bool half) {
                static_cast<LeafT*>(leaf)->readBuffers(stream, half);
            };
        });
        if (!known) throw cumulo::Unsupported("grids of type " + grid.type() + " are not read in parts");
        if (loading->leaves.size() != layout->leaf_count) throw std::runtime_error("the tree has other leaves than it had");
        *out = loading.release();
    });
}

int32_t cumulo_vdb_load_leaves(const cumulo_vdb_loading* loading, size_t first, size_t count, const uint8_t* bytes,
                               size_t length, cumulo_vdb_status* status) {
    return guarded(status, [&] { decode(loading, first, count, bytes, length, [](size_t) {}); });
}

int32_t cumulo_vdb_load_values(const cumulo_vdb_loading* loading, size_t first, size_t count, const uint8_t* bytes,
                               size_t length, const cumulo_vdb_leaf* out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        if (loading->components != 1) throw cumulo::Unsupported("the grid holds vectors, scalars are needed");
        decode(loading, first, count, bytes, length, [&](size_t i) {
            const cumulo_vdb_leaf& leaf = out[i - first];
            loading->copy(loading->leaves[i], *leaf.origin, *leaf.values, *leaf.active);
            loading->release(loading->leaves[i]);
        });
    });
}

int32_t cumulo_vdb_load_end(cumulo_vdb_loading* loading, cumulo_vdb_grid** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const std::unique_ptr<cumulo_vdb_loading> owned(loading);
        auto handle = std::make_unique<cumulo_vdb_grid>();
        if (out) {
            handle->grid = owned->grid;
            *out = handle.release();
        }
    });
}

} // extern "C"
