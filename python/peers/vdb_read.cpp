// OpenVDB's side of the read and write benchmark: reads a file eagerly, copies every leaf's 512 values and
// its mask into one buffer, and writes the grids again. One thread. Prints one JSON line of medians in ms.
//
//   vdb_read IN.vdb OUT.vdb [REPEATS]

#include <openvdb/openvdb.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <tbb/global_control.h>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

double millis(Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

double median(std::vector<double> times) {
    std::sort(times.begin(), times.end());
    return times[times.size() / 2];
}

// What a program needs that goes on with the values elsewhere.
struct Leaves {
    std::vector<openvdb::Coord> origins;
    std::vector<openvdb::util::NodeMask<3>> masks;
    std::vector<float> values;
};

Leaves copy(const openvdb::FloatGrid& grid) {
    const auto count = grid.tree().leafCount();
    Leaves out;
    out.origins.reserve(count);
    out.masks.reserve(count);
    out.values.resize(count * 512);
    float* to = out.values.data();
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf, to += 512) {
        out.origins.push_back(leaf->origin());
        out.masks.push_back(leaf->valueMask());
        std::memcpy(to, leaf->buffer().data(), 512 * sizeof(float));
    }
    return out;
}

openvdb::GridPtrVecPtr read(const char* path) {
    openvdb::io::File file(path);
    file.open(/*delayLoad=*/false);
    auto grids = file.getGrids();
    file.close();
    return grids;
}

void write(const char* path, const openvdb::GridPtrVec& grids) {
    openvdb::io::File file(path);
    file.write(grids);
    file.close();
}

}  // namespace

int main(int argc, char** argv) try {
    if (argc < 3) {
        std::fprintf(stderr, "usage: %s IN.vdb OUT.vdb [REPEATS]\n", argv[0]);
        return 2;
    }
    const int repeats = argc > 3 ? std::max(1, std::atoi(argv[3])) : 5;
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    openvdb::initialize();
    std::vector<double> reads, copies, writes;
    std::size_t leaves = 0;
    double sum = 0;
    for (int i = 0; i < repeats; ++i) {
        auto start = Clock::now();
        const auto grids = read(argv[1]);
        reads.push_back(millis(start));
        start = Clock::now();
        leaves = 0;
        for (const auto& base : *grids) {
            const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(base);
            if (!grid) continue;
            const Leaves copied = copy(*grid);
            leaves += copied.origins.size();
            sum += copied.values[copied.values.size() / 2];
        }
        copies.push_back(millis(start));
        start = Clock::now();
        write(argv[2], *grids);
        writes.push_back(millis(start));
    }
    std::vector<double> both;
    for (int i = 0; i < repeats; ++i) both.push_back(reads[i] + copies[i]);
    std::printf("{\"bench\": \"B10\", \"peer\": \"openvdb\", \"version\": \"%s\", \"leaves\": %zu, \"repeats\": %d, "
                "\"read_ms\": %.1f, \"copy_ms\": %.1f, \"read_and_copy_ms\": %.1f, \"write_ms\": %.1f, \"check\": %.6f}\n",
                openvdb::getLibraryAbiVersionString(), leaves, repeats, median(reads), median(copies), median(both),
                median(writes), sum);
    return 0;
} catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
}
