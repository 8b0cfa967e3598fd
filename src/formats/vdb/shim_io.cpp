// Files and metadata.
#include "shim.hpp"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/Stream.h>

#include <cerrno>
#include <cstdlib>
#include <map>
#include <ostream>
#include <streambuf>
#include <system_error>
#include <unistd.h>
#include <vector>

using namespace openvdb;
using cumulo::guarded;
using cumulo::Part;

namespace {

struct Nowhere : std::streambuf {
    int overflow(int c) override { return c; }
    std::streamsize xsputn(const char*, std::streamsize n) override { return n; }
};

// A file written through its descriptor. OpenVDB never looks at the state of the streams that it writes to: this one
// remembers the first failure, and counts on without writing, so that the caller learns how long the file would have been.
class Sink : public std::streambuf {
public:
    explicit Sink(int fd) : fd(fd), buffer(1 << 20) { setp(buffer.data(), buffer.data() + buffer.size()); }

    uint64_t finish() {
        drain();
        if (error) throw std::system_error(error, std::generic_category(), "writing");
        return length();
    }
    uint64_t length() const { return std::max(end, at + uint64_t(pptr() - pbase())); }

protected:
    int_type overflow(int_type c) override {
        drain();
        if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
        *pptr() = traits_type::to_char_type(c);
        pbump(1);
        return c;
    }
    std::streamsize xsputn(const char* bytes, std::streamsize count) override {
        if (count > epptr() - pptr()) drain();
        if (count > epptr() - pptr()) {
            put(bytes, size_t(count));
        } else {
            std::memcpy(pptr(), bytes, size_t(count));
            pbump(int(count));
        }
        return count;
    }
    int sync() override {
        drain();
        return 0;
    }
    pos_type seekoff(off_type offset, std::ios_base::seekdir way, std::ios_base::openmode) override {
        if (offset == 0 && way == std::ios_base::cur) return pos_type(off_type(at + uint64_t(pptr() - pbase())));
        drain();
        const uint64_t base = way == std::ios_base::beg ? 0 : way == std::ios_base::cur ? at : end;
        const off_type to = off_type(base) + offset;
        if (to < 0) return pos_type(off_type(-1));
        at = uint64_t(to);
        return pos_type(to);
    }
    pos_type seekpos(pos_type to, std::ios_base::openmode which) override {
        return seekoff(off_type(to), std::ios_base::beg, which);
    }

private:
    void drain() {
        const size_t count = size_t(pptr() - pbase());
        setp(buffer.data(), buffer.data() + buffer.size());
        if (count > 0) put(buffer.data(), count);
    }
    void put(const char* bytes, size_t count) {
        for (size_t done = 0; !error && done < count;) {
            const ssize_t put = ::pwrite(fd, bytes + done, count - done, off_t(at + done));
            if (put < 0 && errno == EINTR) continue;
            if (put < 0) error = errno;
            if (put == 0) error = ENOSPC;
            if (put > 0) done += size_t(put);
        }
        at += count;
        end = std::max(end, at);
    }

    int fd;
    int error = 0;
    uint64_t at = 0;
    uint64_t end = 0;
    std::vector<char> buffer;
};

// What `io::File` does around a stream of its own, which cannot be asked how it went, and reads a file of its own.
struct Archive : io::Archive {
    Ptr copy() const override { return std::make_shared<Archive>(*this); }
    // Reads the head of a file, up to the number of its grids.
    MetaMap::Ptr head(std::istream& in) {
        readHeader(in);
        stream = std::make_shared<io::StreamMetadata>();
        stream->setSeekable(true);
        io::setStreamMetadataPtr(in, stream, /*transfer=*/false);
        setFormatVersion(in);
        setLibraryVersion(in);
        setDataCompression(in);
        auto meta = std::make_shared<MetaMap>();
        meta->readMeta(in);
        return meta;
    }
    // Reads all grids of a file, and returns the last one.
    GridBase::Ptr last(std::istream& in) {
        head(in);
        NamedGridMap grids;
        GridBase::Ptr grid;
        for (int32_t left = readGridCount(in); left > 0; --left) {
            io::GridDescriptor descriptor;
            grid = descriptor.read(in);
            if (!grid) break;
            grid->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
            readGrid(grid, descriptor, in);
            grids[descriptor.uniqueName()] = grid;
            connectInstance(descriptor, grids);
        }
        if (!grid) throw std::runtime_error("the library returned no grid");
        return grid;
    }
    void put(std::ostream& out, const GridCPtrVec& grids, const float* const* const* values, const MetaMap& meta) const {
        if (!values) return io::Archive::write(out, grids, /*seekable=*/true, meta);
        // What `io::Archive::write` does, grid by grid.
        auto stream = std::make_shared<io::StreamMetadata>();
        io::setStreamMetadataPtr(out, stream, /*transfer=*/true);
        writeHeader(out, /*seekable=*/true);
        meta.writeMeta(out);
        const auto count = int32_t(grids.size());
        out.write(reinterpret_cast<const char*>(&count), sizeof count);
        std::map<Name, int> times, numbered;
        for (const auto& grid : grids) ++times[grid->getName()];
        for (size_t i = 0; i < grids.size(); ++i) {
            Name name = grids[i]->getName();
            if (name.empty() || times[name] > 1) name = io::GridDescriptor::addSuffix(name, numbered[name]++);
            io::GridDescriptor descriptor(name, grids[i]->type(), grids[i]->saveFloatAsHalf());
            put_grid(out, descriptor, gridConstPtrCast<FloatGrid>(grids[i]), values[i]);
        }
    }

private:
    // What `io::Archive::writeGrid` does, with leaves whose values come one by one: in ascending order of origin.
    void put_grid(std::ostream& out, io::GridDescriptor& descriptor, const FloatGrid::ConstPtr& hollow,
                  const float* const* values) const {
        if (!hollow) throw cumulo::Unsupported("only grids of floats are written leaf by leaf");
        using LeafT = FloatTree::LeafNodeType;
        std::vector<const LeafT*> leaves;
        hollow->tree().getNodes(leaves);
        std::vector<size_t> sorted(leaves.size());
        for (size_t i = 0; i < sorted.size(); ++i) sorted[i] = i;
        std::sort(sorted.begin(), sorted.end(),
                  [&](size_t a, size_t b) { return leaves[a]->origin() < leaves[b]->origin(); });
        std::vector<const float*> own(leaves.size());
        for (size_t i = 0; i < sorted.size(); ++i) own[sorted[i]] = values[i];

        const FloatGrid::Ptr grid = gridPtrCast<FloatGrid>(ConstPtrCast<GridBase>(hollow->copyGrid()));
        grid->addStatsMetadata();
        const Index64 bytes = grid->memUsage() + Index64(leaves.size()) * LeafT::SIZE * sizeof(float);
        grid->insertMeta(GridBase::META_FILE_MEM_BYTES, Int64Metadata(int64_t(bytes)));
        descriptor.writeHeader(out);
        const std::streampos positions = out.tellp();
        descriptor.writeStreamPos(out);
        descriptor.setGridPos(int64_t(out.tellp()));
        setGridCompression(out, *grid);
        grid->insertMeta(GridBase::META_FILE_COMPRESSION,
                         StringMetadata(io::compressionToString(io::getDataCompression(out))));
        grid->writeMeta(out);
        grid->writeTransform(out);
        grid->writeTopology(out);
        descriptor.setBlockPos(int64_t(out.tellp()));
        for (size_t i = 0; i < leaves.size(); ++i) {
            LeafT leaf(leaves[i]->origin());
            std::memcpy(leaf.buffer().data(), own[i], sizeof(float) * LeafT::SIZE);
            leaf.setValueMask(leaves[i]->valueMask());
            leaf.writeBuffers(out, grid->saveFloatAsHalf());
        }
        descriptor.setEndPos(int64_t(out.tellp()));
        out.seekp(positions);
        descriptor.writeStreamPos(out);
        descriptor.seekToEnd(out);
    }

    // The stream that is read has the address of this pointer.
    io::StreamMetadata::Ptr stream;
};

template <typename T> bool put_number(const Metadata& m, cumulo_vdb_meta_entry* out, int32_t kind) {
    const auto* typed = dynamic_cast<const TypedMetadata<T>*>(&m);
    if (!typed) return false;
    out->kind = kind;
    out->count = 1;
    if (kind == CUMULO_VDB_META_FLOAT) {
        out->floats[0] = double(typed->value());
    } else {
        out->ints[0] = int64_t(typed->value());
    }
    return true;
}

template <typename V> bool put_vector(const Metadata& m, cumulo_vdb_meta_entry* out, int32_t kind) {
    const auto* typed = dynamic_cast<const TypedMetadata<V>*>(&m);
    if (!typed) return false;
    out->kind = kind;
    out->count = int32_t(V::size);
    for (int i = 0; i < int(V::size); ++i) {
        if (kind == CUMULO_VDB_META_FLOATS) {
            out->floats[i] = double(typed->value()[i]);
        } else {
            out->ints[i] = int64_t(typed->value()[i]);
        }
    }
    return true;
}

template <typename M> bool put_matrix(const Metadata& m, cumulo_vdb_meta_entry* out) {
    const auto* typed = dynamic_cast<const TypedMetadata<M>*>(&m);
    if (!typed) return false;
    out->kind = CUMULO_VDB_META_FLOATS;
    out->count = int32_t(M::size * M::size);
    for (int i = 0; i < out->count; ++i) out->floats[i] = double(typed->value().asPointer()[i]);
    return true;
}

} // namespace

extern "C" {

const char* cumulo_vdb_version(void) { return getLibraryVersionString(); }

static void (*end_of_all)(const char*) = nullptr;

void cumulo_vdb_on_terminate(void (*handler)(const char* what)) {
    end_of_all = handler;
    std::set_terminate([] {
        const char* what = "an exception of unknown type";
        if (const std::exception_ptr thrown = std::current_exception()) {
            try {
                std::rethrow_exception(thrown);
            } catch (const std::bad_alloc&) {
                what = "out of memory";
            } catch (const std::exception& e) {
                what = e.what();
                end_of_all(what); // the message does not outlive this block
            } catch (...) {
            }
        }
        end_of_all(what);
        std::abort();
    });
}

int32_t cumulo_vdb_file_meta(const uint8_t* bytes, size_t length, cumulo_vdb_meta** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto meta = std::make_unique<cumulo_vdb_meta>();
        Part part(bytes, length);
        Archive archive;
        meta->map = archive.head(part.stream);
        *out = meta.release();
    });
}

int32_t cumulo_vdb_file_grid(const uint8_t* bytes, size_t length, cumulo_vdb_grid** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto handle = std::make_unique<cumulo_vdb_grid>();
        Part part(bytes, length);
        Archive archive;
        handle->grid = archive.last(part.stream);
        *out = handle.release();
    });
}

int32_t cumulo_vdb_touch(const cumulo_vdb_grid* grid, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        Nowhere sink;
        std::ostream out(&sink);
        io::Stream(out).write(GridCPtrVec{grid->grid});
    });
}

int32_t cumulo_vdb_write(int32_t fd, const cumulo_vdb_grid* const* grids, const float* const* const* values,
                         size_t count, const cumulo_vdb_meta* meta, int32_t codec, uint64_t* length,
                         cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        *length = 0;
        GridCPtrVec all;
        for (size_t i = 0; i < count; ++i) all.push_back(grids[i]->grid);
        Archive archive;
        archive.setCompression(codec == 1 ? io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK : io::COMPRESS_ACTIVE_MASK);
        Sink sink(fd);
        std::ostream out(&sink);
        out.exceptions(std::ios_base::badbit | std::ios_base::failbit);
        archive.put(out, all, values, meta ? *meta->map : MetaMap());
        out.flush();
        *length = sink.length();
        sink.finish();
    });
}

int32_t cumulo_vdb_meta_new(cumulo_vdb_meta** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto meta = std::make_unique<cumulo_vdb_meta>();
        meta->map = std::make_shared<MetaMap>();
        *out = meta.release();
    });
}

void cumulo_vdb_meta_free(cumulo_vdb_meta* meta) {
    cumulo_vdb_status ignored;
    guarded(&ignored, [&] { delete meta; });
}

int32_t cumulo_vdb_meta_count(const cumulo_vdb_meta* meta, size_t* out, cumulo_vdb_status* status) {
    return guarded(status, [&] { *out = meta->map->metaCount(); });
}

int32_t cumulo_vdb_meta_get(cumulo_vdb_meta* meta, size_t index, cumulo_vdb_meta_entry* out,
                            cumulo_vdb_status* status) {
    return guarded(status, [&] {
        if (index == 0 || index != meta->next) {
            meta->at = meta->map->beginMeta();
            meta->next = 0;
        }
        for (; meta->next < index && meta->at != meta->map->endMeta(); ++meta->next) ++meta->at;
        if (meta->at == meta->map->endMeta()) throw std::out_of_range("metadata index");
        const auto it = meta->at++;
        ++meta->next;
        *out = cumulo_vdb_meta_entry{};
        out->name = it->first.data();
        out->name_length = it->first.size();
        if (!it->second) return;
        const Metadata& m = *it->second;
        static thread_local std::string type, text;
        type = m.typeName();
        out->type = type.data();
        out->type_length = type.size();
        if (const auto* s = dynamic_cast<const StringMetadata*>(&m)) {
            out->kind = CUMULO_VDB_META_TEXT;
            out->text = s->value().data();
            out->text_length = s->value().size();
            return;
        }
        if (put_number<bool>(m, out, CUMULO_VDB_META_BOOL) || put_number<int32_t>(m, out, CUMULO_VDB_META_INT) ||
            put_number<int64_t>(m, out, CUMULO_VDB_META_INT) || put_number<float>(m, out, CUMULO_VDB_META_FLOAT) ||
            put_number<double>(m, out, CUMULO_VDB_META_FLOAT) || put_vector<Vec2i>(m, out, CUMULO_VDB_META_INTS) ||
            put_vector<Vec3i>(m, out, CUMULO_VDB_META_INTS) || put_vector<Vec4i>(m, out, CUMULO_VDB_META_INTS) ||
            put_vector<Vec2s>(m, out, CUMULO_VDB_META_FLOATS) || put_vector<Vec2d>(m, out, CUMULO_VDB_META_FLOATS) ||
            put_vector<Vec3s>(m, out, CUMULO_VDB_META_FLOATS) || put_vector<Vec3d>(m, out, CUMULO_VDB_META_FLOATS) ||
            put_vector<Vec4s>(m, out, CUMULO_VDB_META_FLOATS) || put_vector<Vec4d>(m, out, CUMULO_VDB_META_FLOATS) ||
            put_matrix<math::Mat4s>(m, out) || put_matrix<math::Mat4d>(m, out)) {
            return;
        }
        text = m.str();
        out->text = text.data();
        out->text_length = text.size();
    });
}

int32_t cumulo_vdb_meta_set(cumulo_vdb_meta* meta, const cumulo_vdb_meta_entry* e, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const std::string name(e->name, e->name_length);
        MetaMap& map = *meta->map;
        meta->next = SIZE_MAX; // iterators are stale
        map.removeMeta(name);
        const bool fits = e->ints[0] >= INT32_MIN && e->ints[0] <= INT32_MAX;
        const bool single = double(float(e->floats[0])) == e->floats[0];
        const auto put = [&](const Metadata& m) { map.insertMeta(name, m); };
        switch (e->kind) {
        case CUMULO_VDB_META_BOOL: return put(BoolMetadata(e->ints[0] != 0));
        case CUMULO_VDB_META_INT:
            return fits ? put(Int32Metadata(int32_t(e->ints[0]))) : put(Int64Metadata(e->ints[0]));
        case CUMULO_VDB_META_FLOAT:
            return single ? put(FloatMetadata(float(e->floats[0]))) : put(DoubleMetadata(e->floats[0]));
        case CUMULO_VDB_META_TEXT: return put(StringMetadata(std::string(e->text, e->text_length)));
        case CUMULO_VDB_META_INTS: {
            const auto at = [&](int i) { return int32_t(e->ints[i]); };
            if (e->count == 2) return put(Vec2IMetadata(Vec2i(at(0), at(1))));
            if (e->count == 3) return put(Vec3IMetadata(Vec3i(at(0), at(1), at(2))));
            if (e->count == 4) return put(TypedMetadata<Vec4i>(Vec4i(at(0), at(1), at(2), at(3))));
            break;
        }
        case CUMULO_VDB_META_FLOATS: {
            const double* f = e->floats;
            if (e->count == 2) return put(Vec2DMetadata(Vec2d(f[0], f[1])));
            if (e->count == 3) return put(Vec3DMetadata(Vec3d(f[0], f[1], f[2])));
            if (e->count == 4) return put(TypedMetadata<Vec4d>(Vec4d(f[0], f[1], f[2], f[3])));
            if (e->count == 16) return put(Mat4DMetadata(math::Mat4d(f)));
            break;
        }
        default: break;
        }
        throw cumulo::Unsupported("metadata of this shape cannot be written");
    });
}

} // extern "C"
