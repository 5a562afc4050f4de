"""Build the face, its light and its camera in Blender (4.3 or newer). Written by `unlit export`.

    blender --python blender.py
    blender --background --python blender.py -- picture.png

The second form renders the photo's view into a file. The material has two normals, as unlit's
model has: a diffuse BSDF, and a metallic one (Beckmann; a conductor with index of refraction
1.38 and no absorption reflects as skin does). A new file is begun; it is in metres, z up, the
camera at the origin. Reads blender.json, mesh.obj and the EXR files that lie beside it.

DETAIL says what gives the skin its fine relief: the normal maps, which is what unlit renders, or
the displacement map, as bump or by moving the surface. Two at once would count it twice.
"""

import json
import math
import sys
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]

#: "normals", "bump" or "displacement".
DETAIL = "normals"
#: To be displaced, each triangle is split in four this many times: 2 makes edges of half a
#: millimetre, and takes some 1 GB.
SUBDIVISIONS = 2

FOLDER = Path(__file__).resolve().parent
MILLIMETRE = 0.001


def nodes_of(owner):
    """The empty node tree of a new material or world."""
    if not owner.node_tree:  # before Blender 5 it had to be asked for
        owner.use_nodes = True
    owner.node_tree.nodes.clear()
    return owner.node_tree


def image_node(tree, file, colours="Non-Color", kind="ShaderNodeTexImage"):
    """A texture node that shows `file`."""
    node = tree.nodes.new(kind)
    node.image = bpy.data.images.load(str(FOLDER / file), check_existing=True)
    node.image.colorspace_settings.name = colours
    return node


def normal_of(tree, file):
    """Output of a tangent-space normal map."""
    node = tree.nodes.new("ShaderNodeNormalMap")
    tree.links.new(image_node(tree, file).outputs["Color"], node.inputs["Color"])
    return node.outputs["Normal"]


def math_of(tree, operation, value, second=0.0):
    """Output of a math node on the output `value` and a number."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    node.inputs[1].default_value = second
    tree.links.new(value, node.inputs[0])
    return node.outputs["Value"]


def displaced(tree, file):
    """Output of a displacement along the normal, by millimetres in `file`."""
    node = tree.nodes.new("ShaderNodeDisplacement")
    node.space = "WORLD"  # metres, whatever the object's scale
    node.inputs["Midlevel"].default_value = 0.0
    node.inputs["Scale"].default_value = MILLIMETRE
    tree.links.new(image_node(tree, file).outputs["Color"], node.inputs["Height"])
    return node.outputs["Displacement"]


def face_material(settings):
    """Diffuse plus specular, each with its own normal; the displacement in its place or unused."""
    material = bpy.data.materials.new("unlit face")
    tree = nodes_of(material)

    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    albedo = image_node(tree, "atlas_diffuse_albedo.exr", "Linear Rec.709")
    tree.links.new(albedo.outputs["Color"], diffuse.inputs["Color"])
    bends = {diffuse: normal_of(tree, "atlas_diffuse_normal.exr")}

    lobe = tree.nodes.new("ShaderNodeBsdfMetallic")
    lobe.distribution = "BECKMANN"
    lobe.fresnel_type = "PHYSICAL_CONDUCTOR"
    lobe.inputs["IOR"].default_value = (settings["ior"],) * 3
    lobe.inputs["Extinction"].default_value = (0.0, 0.0, 0.0)
    alpha = image_node(tree, "atlas_roughness.exr").outputs["Color"]
    tree.links.new(math_of(tree, "SQRT", alpha), lobe.inputs["Roughness"])
    bends[lobe] = normal_of(tree, "atlas_specular_normal.exr")

    # A shader can be scaled down only: by the specular albedo over a power of two, which is then
    # made good by adding the shader to itself.
    doublings = settings["specular_doublings"]
    specular = image_node(tree, "atlas_specular_albedo.exr").outputs["Color"]
    scaled = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(math_of(tree, "MULTIPLY", specular, 0.5**doublings), scaled.inputs[0])
    tree.links.new(lobe.outputs[0], scaled.inputs[2])
    shader = scaled
    for _ in range(doublings):
        twice = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(shader.outputs[0], twice.inputs[0])
        tree.links.new(shader.outputs[0], twice.inputs[1])
        shader = twice
    both = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(diffuse.outputs[0], both.inputs[0])
    tree.links.new(shader.outputs[0], both.inputs[1])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(both.outputs[0], output.inputs["Surface"])

    height = displaced(tree, "atlas_displacement.exr")
    if DETAIL == "normals":
        for lobe, bend in bends.items():
            tree.links.new(bend, lobe.inputs["Normal"])
    else:
        material.displacement_method = DETAIL.upper()
        tree.links.new(height, output.inputs["Displacement"])
    return material


def add_face(settings):
    """The mesh, y up in centimetres in the file, z up in metres here."""
    before = set(bpy.data.objects)
    bpy.ops.wm.obj_import(
        filepath=str(FOLDER / "mesh.obj"),
        global_scale=0.01,
        forward_axis="NEGATIVE_Z",
        up_axis="Y",
    )
    material = face_material(settings)
    for face in set(bpy.data.objects) - before:
        for slot in face.material_slots:
            slot.material = material
        if DETAIL == "displacement":
            split = face.modifiers.new("displacement", "SUBSURF")
            split.subdivision_type = "SIMPLE"
            split.levels, split.render_levels = 0, SUBDIVISIONS


def add_light(settings):
    """The photo's light as the world."""
    world = bpy.data.worlds.new("unlit light")
    bpy.context.scene.world = world
    tree = nodes_of(world)
    picture = image_node(tree, "environment.exr", "Linear Rec.709", "ShaderNodeTexEnvironment")
    turned = tree.nodes.new("ShaderNodeMapping")
    turned.inputs["Rotation"].default_value = (0.0, 0.0, math.radians(settings["light_turn"]))
    place = tree.nodes.new("ShaderNodeTexCoord")
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(place.outputs["Generated"], turned.inputs["Vector"])
    tree.links.new(turned.outputs["Vector"], picture.inputs["Vector"])
    tree.links.new(picture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs[0], output.inputs["Surface"])


def add_camera(settings):
    """The crop's camera, at the origin, looking along y."""
    data = bpy.data.cameras.new("photo camera")
    data.sensor_fit = "HORIZONTAL"
    data.angle_x = settings["fov_x"]
    data.shift_x, data.shift_y = settings["shift"]
    data.clip_start = 0.01
    camera = bpy.data.objects.new("photo camera", data)
    camera.rotation_euler = (math.pi / 2, 0.0, 0.0)
    scene = bpy.context.scene
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = settings["size"]
    scene.render.resolution_percentage = 100


def set_renderer():
    """Cycles, three bounces, colours as they are."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    cycles = scene.cycles
    cycles.samples = 128
    cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 3


def render(path):
    """Render the camera's view into `path`: EXR or PNG."""
    settings = bpy.context.scene.render
    settings.image_settings.file_format = "OPEN_EXR" if path.endswith(".exr") else "PNG"
    settings.image_settings.color_mode = "RGBA"
    settings.filepath = str(Path(path).resolve())
    bpy.ops.render.render(write_still=True)


def main():
    settings = json.loads((FOLDER / "blender.json").read_text(encoding="utf-8"))
    bpy.ops.wm.read_homefile(use_empty=True)
    add_face(settings)
    add_light(settings)
    add_camera(settings)
    set_renderer()
    if "--" in sys.argv[:-1]:
        render(sys.argv[sys.argv.index("--") + 1])


if __name__ == "__main__":
    main()
