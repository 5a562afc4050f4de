// The head as a mesh of three.js with our reflectance as its material.

import {
  BufferAttribute,
  BufferGeometry,
  GLSL3,
  LinearMipmapLinearFilter,
  Mesh,
  RawShaderMaterial,
  SRGBColorSpace,
  Texture,
  Vector3,
} from "three";
import ball from "./ball.glsl";
import brdf from "./brdf.glsl";
import vertexShader from "./face.vert.glsl";
import fragmentShader from "./face.frag.glsl";

/** What can be switched off, by the name of its uniform. */
export const SWITCHES = [
  "useDiffuseAlbedo",
  "useSpecularAlbedo",
  "useRoughness",
  "useSpecularNormal",
  "useDiffuseNormal",
  "useDiffuse",
  "useSpecular",
  "useShadow",
  "onlyMeasured",
];

/** Texture of an <img> of the page that has been decoded. */
function textureOf(image, sRGB) {
  const texture = new Texture(image);
  if (sRGB) texture.colorSpace = SRGBColorSpace;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** The head of `scene` with the textures `images`, lit by `balls` (ball.js). */
export function headOf(scene, images, balls) {
  const { position, normal, tangent, uv, clear, hidden, triangles } = scene.arrays;
  const geometry = new BufferGeometry();
  const attribute = (array, size) => new BufferAttribute(array, size, true);
  geometry.setAttribute("position", attribute(position, 3));
  geometry.setAttribute("normal", attribute(normal, 3));
  geometry.setAttribute("tangent", attribute(tangent, 4));
  geometry.setAttribute("uv", attribute(uv, 2));
  geometry.setAttribute("clear", attribute(clear, 3));
  geometry.setAttribute("hidden", attribute(hidden, 1));
  for (const name of ["open", "direct"]) // light.js fills them in
    geometry.setAttribute(name, new BufferAttribute(new Float32Array(position.length), 3));
  geometry.setIndex(new BufferAttribute(triangles, 1));

  const uniforms = {
    low: new Vector3(...scene.low),
    extent: new Vector3(...scene.extent),
    eye: new Vector3(),
    exposure: 1,
    balls: balls.texture,
    toBall: balls.toBall,
    diffuseAlbedo: textureOf(images.diffuseAlbedo, true),
    material: textureOf(images.material),
    specularNormal: textureOf(images.specularNormal),
    diffuseNormal: textureOf(images.diffuseNormal),
    ...Object.fromEntries(SWITCHES.map((name) => [name, name === "onlyMeasured" ? 0 : 1])),
  };
  const material = new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader,
    fragmentShader: `precision highp float;\n${brdf}${ball}${fragmentShader}`,
    uniforms: Object.fromEntries(Object.entries(uniforms).map(([k, value]) => [k, { value }])),
  });
  const mesh = new Mesh(geometry, material);
  mesh.frustumCulled = false; // the bounds of quantised positions mean nothing
  return mesh;
}
