// Surfaces of volumes as polygons, and volumes of polygons.
#include "shim.hpp"

#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <vector>

using namespace openvdb;
using cumulo::guarded;

struct cumulo_vdb_surface {
    // In index space, relative to a place amid the grid: floats would lose digits of points far from the origin.
    std::vector<Vec3s> points;
    Vec3d centre{0.0};
    bool finite = true;
    std::vector<Vec3I> triangles;
    std::vector<Vec4I> quads;
};

namespace {

// Polygons as the voxelization asks for them, with points in double precision.
class Polygons {
public:
    explicit Polygons(const cumulo_vdb_polygons& polygons) : mPolygons(polygons) {}
    size_t polygonCount() const { return mPolygons.polygon_count; }
    size_t pointCount() const { return mPolygons.point_count; }
    size_t vertexCount(size_t n) const { return mPolygons.corners[n][3] == UINT32_MAX ? 3 : 4; }
    void getIndexSpacePoint(size_t n, size_t v, Vec3d& position) const {
        position = Vec3d(mPolygons.points[mPolygons.corners[n][v]]);
    }

private:
    const cumulo_vdb_polygons& mPolygons;
};

// Corners of polygons, in their order or against it.
template <typename PolygonT>
void copy(const std::vector<PolygonT>& from, uint32_t (*to)[PolygonT::size], bool reverse) {
    constexpr int n = PolygonT::size;
    for (size_t i = 0; i < from.size(); ++i) {
        for (int c = 0; c < n; ++c) to[i][c] = from[i][reverse ? n - 1 - c : c];
    }
}

} // namespace

extern "C" {

int32_t cumulo_vdb_surface_new(const cumulo_vdb_grid* handle, double iso, double adaptivity, cumulo_vdb_surface** out,
                               cumulo_vdb_status* status) {
    return guarded(status, [&] {
        auto surface = std::make_unique<cumulo_vdb_surface>();
        const bool known = handle->grid->apply<TypeList<FloatGrid, DoubleGrid>>([&](const auto& grid) {
            using GridT = std::decay_t<decltype(grid)>;
            const typename GridT::Ptr plain = GridT::create(std::const_pointer_cast<typename GridT::TreeType>(
                grid.constTreePtr()));
            plain->setGridClass(GRID_LEVEL_SET);
            CoordBBox box;
            if (grid.tree().evalActiveVoxelBoundingBox(box)) {
                const Vec3d middle = box.getCenter();
                for (int c = 0; c < 3; ++c) surface->centre[c] = std::floor(middle[c]);
            }
            plain->transform().postTranslate(-surface->centre);
            try {
                tools::volumeToMesh(*plain, surface->points, surface->triangles, surface->quads, iso, adaptivity);
            } catch (const ValueError&) {
                surface->finite = false;
            }
        });
        if (!known) {
            throw cumulo::Unsupported("grids of type " + handle->grid->type()
                                      + " hold no distances or densities (float or double)");
        }
        for (const Vec3s& point : surface->points) surface->finite = surface->finite && point.isFinite();
        *out = surface.release();
    });
}

void cumulo_vdb_surface_free(cumulo_vdb_surface* surface) { delete surface; }

int32_t cumulo_vdb_surface_count(const cumulo_vdb_surface* surface, cumulo_vdb_surface_counts* out,
                                 cumulo_vdb_status* status) {
    return guarded(status, [&] {
        *out = {surface->points.size(), surface->triangles.size(), surface->quads.size(), surface->finite};
    });
}

int32_t cumulo_vdb_surface_copy(const cumulo_vdb_surface* surface, const cumulo_vdb_surface_counts* room,
                                int32_t reverse, double (*points)[3], uint32_t (*triangles)[3], uint32_t (*quads)[4],
                                cumulo_vdb_status* status) {
    return guarded(status, [&] {
        if (room->points < surface->points.size() || room->triangles < surface->triangles.size()
            || room->quads < surface->quads.size()) {
            throw cumulo::Unsupported("there is less room than the surface needs");
        }
        for (size_t i = 0; i < surface->points.size(); ++i) {
            for (int c = 0; c < 3; ++c) points[i][c] = surface->centre[c] + double(surface->points[i][c]);
        }
        copy(surface->triangles, triangles, reverse != 0);
        copy(surface->quads, quads, reverse != 0);
    });
}

int32_t cumulo_vdb_grid_from_polygons(const cumulo_vdb_polygons* polygons, double voxel, float half_width,
                                      cumulo_vdb_grid** out, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const double matrix[16] = {voxel, 0, 0, 0, 0, voxel, 0, 0, 0, 0, voxel, 0, 0, 0, 0, 1};
        const Polygons mesh(*polygons);
        const FloatGrid::Ptr grid =
            tools::meshToVolume<FloatGrid>(mesh, *cumulo::linear_transform(matrix), half_width, half_width);
        *out = new cumulo_vdb_grid{grid};
    });
}

} // extern "C"
