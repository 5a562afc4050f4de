// The scene that report/scene.py packed: numbers, and named arrays in one deflated block.

const KINDS = { u1: Uint8Array, u2: Uint16Array, i2: Int16Array, u4: Uint32Array, f4: Float32Array };

/** The scene in the page's elements `scene` (JSON) and `arrays` (base64). */
export async function sceneOf(page) {
  const scene = JSON.parse(page.getElementById("scene").textContent);
  const text = atob(page.getElementById("arrays").textContent);
  const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = await new Response(stream).arrayBuffer();
  for (const [name, { kind, offset, length }] of Object.entries(scene.arrays))
    scene.arrays[name] = new KINDS[kind](bytes, offset, length);
  for (const light of Object.values(scene.lights)) light.radiance = scene.arrays[light.radiance];
  return scene;
}
