// Level sets to fog volumes, and fog volumes to level sets.
#include "shim.hpp"

#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <openvdb/tree/LeafManager.h>

#include <type_traits>
#include <vector>

using namespace openvdb;
using cumulo::guarded;

namespace {

using RealGrids = TypeList<FloatGrid, DoubleGrid>;

[[noreturn]] void refuse(const cumulo_vdb_grid* grid) {
    throw cumulo::Unsupported("grids of type " + grid->grid->type() + " hold no distances or densities (float or double)");
}

// A mesh tells distances but not sides: rays of the mesh's voxelization call cavities inside. The densities themselves
// say on which side of the surface a voxel lies.
template <typename GridT> typename GridT::Ptr level_set(GridT& in, double iso, double voxel, float half_width) {
    using TreeT = typename GridT::TreeType;
    using V = typename GridT::ValueType;
    // In index space, so that distances are those of voxels wherever the grid lies in the world.
    const typename GridT::Ptr plain = GridT::create(in.treePtr());
    std::vector<Vec3s> points;
    std::vector<Vec4I> quads;
    tools::volumeToMesh(*plain, points, quads, iso);
    if (quads.empty()) throw cumulo::Unsupported("no surface lies among the values");
    const typename GridT::Ptr out = tools::meshToUnsignedDistanceField<GridT>(
        *math::Transform::createLinearTransform(1.0), points, std::vector<Vec3I>(), quads, half_width);
    const V background = V(half_width * voxel);
    tree::LeafManager<TreeT> leaves(out->tree());
    leaves.foreach ([&](auto& leaf, size_t) {
        tree::ValueAccessor<const TreeT> densities(in.tree());
        for (auto it = leaf.beginValueAll(); it; ++it) {
            const V distance = it.isValueOn() ? V(double(*it) * voxel) : background;
            it.setValue(double(densities.getValue(it.getCoord())) >= iso ? -distance : distance);
        }
    });
    tools::changeBackground(out->tree(), background);
    tools::signedFloodFillWithValues(out->tree(), background, -background);
    tools::pruneLevelSet(out->tree());
    static_cast<MetaMap&>(*out) = static_cast<const MetaMap&>(in);
    out->setTransform(in.transformPtr());
    out->setGridClass(GRID_LEVEL_SET);
    return out;
}

} // namespace

extern "C" {

int32_t cumulo_vdb_grid_to_fog(cumulo_vdb_grid* handle, cumulo_vdb_status* status) {
    return guarded(status, [&] {
        const bool known = handle->grid->apply<RealGrids>([&](auto& grid) { tools::sdfToFogVolume(grid); });
        if (!known) refuse(handle);
    });
}

int32_t cumulo_vdb_grid_to_level_set(cumulo_vdb_grid* handle, double iso, double voxel, float half_width,
                                     cumulo_vdb_status* status) {
    return guarded(status, [&] {
        GridBase::Ptr made;
        handle->grid->apply<RealGrids>([&](auto& grid) { made = level_set(grid, iso, voxel, half_width); });
        if (!made) refuse(handle);
        handle->grid = made;
    });
}

} // extern "C"
