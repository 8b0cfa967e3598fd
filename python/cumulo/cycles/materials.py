"""Node trees of media."""

import bpy


def _density_nodes(tree, grid, factor):
    """Output socket of `factor` times the grid's value; the float `factor` when there is no grid."""
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = factor
    if grid is None:
        scale.inputs[0].default_value = 1.0
    else:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = grid
        tree.links.new(attribute.outputs["Fac"], scale.inputs[0])
    return scale.outputs[0]


def _function_nodes(tree, grid, settings):
    """Output socket of the settings' function of the grid's value, times their density scale."""
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    while len(stops) < len(settings.function):
        stops.new(0.5)
    for stop, (density, share) in zip(stops, settings.function):
        stop.position, stop.color = density, (share, share, share, 1)
    tree.links.new(_density_nodes(tree, grid, 1.0), ramp.inputs["Fac"])
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = settings.density_scale
    tree.links.new(ramp.outputs["Color"], scale.inputs[0])
    return scale.outputs[0]


def medium_material(settings, grid):
    """Grey absorption, and the emission that keeps a constant source radiance: the emission density
    is extinction times that radiance."""
    material = bpy.data.materials.new("medium")
    tree = material.node_tree
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeOutputMaterial")
    if settings.model == "scattering":
        medium = tree.nodes.new("ShaderNodeVolumePrincipled")
        medium.inputs["Color"].default_value = (*settings.albedo, 1)
        medium.inputs["Anisotropy"].default_value = settings.anisotropy
        medium.inputs["Absorption Color"].default_value = (*settings.absorption_color, 1)
        medium.inputs["Density Attribute"].default_value = ""
        if any(settings.emission):
            emitting = (settings.emission_grid, 1.0) if settings.emission_grid else (grid, settings.density_scale)
            medium.inputs["Emission Color"].default_value = (*settings.emission, 1)
            tree.links.new(_density_nodes(tree, *emitting), medium.inputs["Emission Strength"])
        if settings.blackbody:
            medium.inputs["Blackbody Intensity"].default_value = settings.blackbody
            medium.inputs["Temperature"].default_value = settings.kelvin
        density = _density_nodes(tree, grid, settings.density_scale)
        if settings.function:
            density = _function_nodes(tree, grid, settings)
        tree.links.new(density, medium.inputs["Density"])
        tree.links.new(medium.outputs[0], surface.inputs["Volume"])
        return material
    medium = tree.nodes.new("ShaderNodeVolumeAbsorption")
    medium.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(_density_nodes(tree, grid, settings.density_scale), medium.inputs["Density"])
    if settings.model == "emission-absorption":
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (*settings.emission, 1)
        tree.links.new(_density_nodes(tree, grid, settings.density_scale), emission.inputs["Strength"])
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(medium.outputs[0], both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        medium = both
    tree.links.new(medium.outputs[0], surface.inputs["Volume"])
    return material
