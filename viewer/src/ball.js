// The light as the head's shader wants it: a small picture of balls that it lights (ball.glsl).

import {
  BufferAttribute,
  BufferGeometry,
  GLSL3,
  HalfFloatType,
  Matrix3,
  Mesh,
  RawShaderMaterial,
  Scene,
  Vector3,
  Vector4,
  WebGLRenderTarget,
} from "three";
import ball from "./ball.glsl";
import brdf from "./brdf.glsl";
import vertexShader from "./ball.vert.glsl";
import fragmentShader from "./ball.frag.glsl";

/** Lights in the shader. */
export const LIGHTS = 32;
const BALLS = 5;
const SIDE = 40; // pixels of a ball

// Written out: software renderers are slow at a loop's indices.
const everyLight = Array.from({ length: LIGHTS }, (_, k) => `LIGHT(${k})`).join("\n");

export class Balls {
  constructor() {
    this.target = new WebGLRenderTarget(BALLS * SIDE, SIDE, {
      type: HalfFloatType,
      depthBuffer: false,
    });
    this.texture = this.target.texture;
    this.toBall = new Matrix3();
    const vectors = () => Array.from({ length: LIGHTS }, () => new Vector4(0, 0, 1, 0));
    const material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader,
      fragmentShader: `precision highp float;\n${brdf}${ball}${fragmentShader}`
        .replaceAll("EVERY_LIGHT", everyLight)
        .replaceAll("LIGHTS", LIGHTS),
      uniforms: {
        axis: { value: vectors() },
        flux: { value: vectors() },
        toBall: { value: this.toBall },
      },
      depthTest: false,
    });
    this.uniforms = material.uniforms;
    const corners = new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]);
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(corners, 3));
    const triangle = new Mesh(geometry, material);
    triangle.frustumCulled = false;
    this.world = new Scene().add(triangle);
  }

  /** Take `lights` (of `turnedLights`). */
  light(lights) {
    const { axis, flux } = this.uniforms;
    lights.forEach((light, k) => {
      axis.value[k].set(...light.axis, light.blur);
      flux.value[k].set(...light.flux, light.cosine);
    });
  }

  /** Draw the balls as seen from `camera`, when they stand at `middle`. */
  draw(renderer, camera, middle) {
    const towards = new Vector3().subVectors(camera.position, middle).normalize();
    const right = new Vector3(0, 1, 0).cross(towards).normalize();
    const up = new Vector3().crossVectors(towards, right);
    this.toBall.set(...right, ...up, ...towards);
    renderer.setRenderTarget(this.target);
    renderer.render(this.world, camera);
    renderer.setRenderTarget(null);
  }
}
