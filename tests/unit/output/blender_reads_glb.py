"""Run by Blender's Python in a test: face.glb as Blender sees it, and a picture of it.

    python blender_reads_glb.py face.glb environment.exr picture.exr width height

Prints one line of JSON: by object its shape keys, and how far jawOpen moves the teeth and the face.
"""

import json
import sys

import bpy  # pyright: ignore[reportMissingImports]


def main():
    glb, environment, picture, width, height = sys.argv[-5:]
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=glb)
    meshes = [item for item in bpy.data.objects if item.type == "MESH"]
    keys = {
        item.name: [key.name for key in item.data.shape_keys.key_blocks[1:]]
        for item in meshes
        if item.data.shape_keys
    }
    travel = {}
    for item in meshes:
        if "jawOpen" in keys.get(item.name, ()):
            block = item.data.shape_keys.key_blocks["jawOpen"]
            block.value = 1.0
            graph = bpy.context.evaluated_depsgraph_get()
            graph.update()
            moved = item.evaluated_get(graph).data.vertices
            pairs = zip(moved, item.data.vertices, strict=True)
            travel[item.name] = max((a.co - b.co).length for a, b in pairs)
            block.value = 0.0
    render(environment, picture, int(width), int(height))
    print("\n" + json.dumps({"keys": keys, "travel": travel}))


def render(environment, picture, width, height):
    """What the file's camera sees under the map, which is as glTF viewers have it."""
    scene = bpy.context.scene
    world = bpy.data.worlds.new("light")
    scene.world = world
    if not world.node_tree:
        world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(environment)
    image.image.colorspace_settings.name = "Linear Rec.709"
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(image.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    scene.camera = next(item for item in bpy.data.objects if item.type == "CAMERA")
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x = width
    scene.render.resolution_y = height
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.view_settings.view_transform = "Standard"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 3
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
