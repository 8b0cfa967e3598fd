// Files and metadata.
#include "shim.hpp"

#include <openvdb/io/File.h>
#include <openvdb/io/Stream.h>

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <mutex>
#include <streambuf>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

using namespace openvdb;
using cumulo::guarded;

struct cumulo_vdb_file {
    explicit cumulo_vdb_file(const std::string& path) : file(path) {}
    io::File file;
};

namespace {

// One grid at a time is read under a limit, which is the whole process's.
std::mutex& limit_mutex() {
    static std::mutex m;
    return m;
}

// Lowers the soft limit on private memory while a grid is read whose contents could not be checked
// beforehand, so that a hostile length ends in bad_alloc instead of in the kernel's killer. Under
// `limit_mutex`.
class DataLimit {
public:
    explicit DataLimit(uint64_t growth) {
        unsigned long long pages[6] = {};
        std::FILE* f = std::fopen("/proc/self/statm", "r");
        if (!f) return;
        const int got = std::fscanf(f, "%llu %llu %llu %llu %llu %llu", &pages[0], &pages[1], &pages[2], &pages[3],
                                    &pages[4], &pages[5]);
        std::fclose(f);
        if (got != 6 || getrlimit(RLIMIT_DATA, &before) != 0) return;
        const rlim_t now = rlim_t(pages[5]) * rlim_t(sysconf(_SC_PAGESIZE));
        struct rlimit limit = before;
        limit.rlim_cur = growth < before.rlim_cur - std::min(now, before.rlim_cur) ? now + rlim_t(growth) : before.rlim_cur;
        lowered = setrlimit(RLIMIT_DATA, &limit) == 0;
    }
    ~DataLimit() {
        if (lowered) setrlimit(RLIMIT_DATA, &before);
    }
    DataLimit(const DataLimit&) = delete;
    DataLimit& operator=(const DataLimit&) = delete;

private:
    struct rlimit before {};
    bool lowered = false;
};

struct Nowhere : std::streambuf {
    int overflow(int c) override { return c; }
    std::streamsize xsputn(const char*, std::streamsize n) override { return n; }
};

// Reads a grid, all its attributes included, in a child that may die of it. OpenVDB answers damaged
// point attributes with assertions and with exceptions in destructors, which nothing can catch.
void rehearse(const std::string& path, const char* name, uint64_t data_limit) {
    const pid_t child = fork();
    if (child < 0) throw std::runtime_error("no child process to try the grid in");
    if (child == 0) {
        const struct rlimit none = {0, 0};
        setrlimit(RLIMIT_CORE, &none);
        const int null = open("/dev/null", O_WRONLY);
        if (null >= 0) dup2(null, STDERR_FILENO);
        alarm(120); // whatever hangs is stopped
        try {
            DataLimit limit(data_limit);
            io::File file(path);
            file.open(/*delayLoad=*/false);
            GridPtrVec grids{file.readGrid(name)};
            // Writing touches every page of every attribute.
            Nowhere sink;
            std::ostream out(&sink);
            io::Stream(out).write(grids);
            grids.clear();
        } catch (...) {
            // The parent meets the same exception where it can be reported.
        }
        _exit(0);
    }
    int state = 0;
    while (waitpid(child, &state, 0) < 0 && errno == EINTR) {
    }
    if (WIFSIGNALED(state)) {
        throw std::runtime_error("reading the grid's buffers ends the library with signal " +
                                 std::to_string(WTERMSIG(state)) + "; they are damaged");
    }
}

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

int32_t cumulo_vdb_open(const char* path, cumulo_vdb_file** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        auto handle = std::make_unique<cumulo_vdb_file>(path);
        // Delayed loading crashes on damaged files with signals that nothing can catch.
        handle->file.open(/*delayLoad=*/false);
        *out = handle.release();
    });
}

void cumulo_vdb_close(cumulo_vdb_file* file) {
    cumulo_vdb_status ignored;
    guarded(&ignored, [&] { delete file; });
}

int32_t cumulo_vdb_file_meta(cumulo_vdb_file* file, cumulo_vdb_meta** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto meta = std::make_unique<cumulo_vdb_meta>();
        const MetaMap::ConstPtr found = file->file.getMetadata();
        meta->map = found ? found->deepCopyMeta() : std::make_shared<MetaMap>();
        *out = meta.release();
    });
}

int32_t cumulo_vdb_read(cumulo_vdb_file* file, const char* unique_name, uint64_t data_limit, cumulo_vdb_grid** out,
                        cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto handle = std::make_unique<cumulo_vdb_grid>();
        if (data_limit > 0) {
            // Locked before the fork: the child inherits the lock, and nobody else in it could give it back.
            const std::lock_guard<std::mutex> lock(limit_mutex());
            rehearse(file->file.filename(), unique_name, data_limit);
            DataLimit limit(data_limit);
            handle->grid = file->file.readGrid(unique_name);
        } else {
            handle->grid = file->file.readGrid(unique_name);
        }
        if (!handle->grid) throw std::runtime_error("the library returned no grid");
        *out = handle.release();
    });
}

int32_t cumulo_vdb_write(const char* path, const cumulo_vdb_grid* const* grids, size_t count,
                         const cumulo_vdb_meta* meta, int32_t codec, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        initialize();
        GridCPtrVec all;
        for (size_t i = 0; i < count; ++i) all.push_back(grids[i]->grid);
        io::File file(path);
        file.setCompression(codec == 1 ? io::COMPRESS_BLOSC | io::COMPRESS_ACTIVE_MASK : io::COMPRESS_ACTIVE_MASK);
        file.write(all, meta ? *meta->map : MetaMap());
        file.close();
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

size_t cumulo_vdb_meta_count(const cumulo_vdb_meta* meta) { return meta->map->metaCount(); }

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
