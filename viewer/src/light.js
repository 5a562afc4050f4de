// Lights as the shader wants them: a few spherical Gaussians, and how much of each reaches each
// vertex. A light comes as radiance on a latitude-longitude grid in the frame of scene/camera.py.

import { Matrix3, Vector3 } from "three";

/** Directions of the cells of visibility that report/scene.py traced. */
const ROWS = 18;
const COLUMNS = 36;
const ROUNDS = 8;

/** Unit direction of row v, column u, each from 0 to 1. */
export function direction(u, v) {
  const phi = 2 * Math.PI * u;
  const theta = Math.PI * v;
  const sine = Math.sin(theta);
  return new Vector3(Math.sin(phi) * sine, Math.cos(theta), -Math.cos(phi) * sine);
}

/** The pixels that shine of `grid`: {rows, columns, radiance: 3 floats a pixel, row by row}. */
function shining({ rows, columns, radiance }) {
  const found = [];
  let total = 0;
  for (let i = 0; i < rows; i++) {
    const angle =
      (Math.cos((Math.PI * i) / rows) - Math.cos((Math.PI * (i + 1)) / rows)) *
      ((2 * Math.PI) / columns);
    for (let j = 0; j < columns; j++) {
      const at = 3 * (i * columns + j);
      const flux = [0, 1, 2].map((c) => radiance[at + c] * angle);
      const power = flux[0] + flux[1] + flux[2];
      total += power;
      if (power > 0)
        found.push({ flux, power, towards: direction((j + 0.5) / columns, (i + 0.5) / rows) });
    }
  }
  return found.filter((pixel) => pixel.power > 1e-6 * total);
}

/** `count` axes spread where the light is: each next one where most light is furthest from all. */
function spread(pixels, count) {
  const gap = pixels.map(() => 2);
  const axes = [];
  while (axes.length < count) {
    let best = 0;
    pixels.forEach((pixel, i) => {
      if (pixel.power * gap[i] > pixels[best].power * gap[best]) best = i;
    });
    const axis = pixels[best].towards.clone();
    axes.push(axis);
    pixels.forEach((pixel, i) => (gap[i] = Math.min(gap[i], 1 - pixel.towards.dot(axis))));
  }
  return axes;
}

/**
 * The light `grid` merged into `count` spherical Gaussians (k-means on the sphere, weighted by
 * flux): axis, flux (linear sRGB), power (their sum), mean cosine, blur (face.frag.glsl), pixels.
 */
export function merged(grid, count) {
  const pixels = shining(grid);
  let axes = spread(pixels, count);
  let groups = [];
  for (let round = 0; round < ROUNDS; round++) {
    groups = axes.map(() => []);
    for (const pixel of pixels) {
      let best = 0;
      for (let k = 1; k < count; k++)
        if (axes[k].dot(pixel.towards) > axes[best].dot(pixel.towards)) best = k;
      groups[best].push(pixel);
    }
    axes = groups.map((group, k) => {
      const sum = new Vector3();
      for (const { towards, power } of group) sum.addScaledVector(towards, power);
      return group.length ? sum.normalize() : axes[k];
    });
  }
  return groups.map((group, k) => {
    const flux = [0, 0, 0];
    let [power, along] = [0, 0];
    for (const pixel of group) {
      pixel.flux.forEach((value, c) => (flux[c] += value));
      power += pixel.power;
      along += pixel.power * pixel.towards.dot(axes[k]);
    }
    const cosine = power ? along / power : 1;
    // The variance of a narrow lobe per axis is 1 - its mean cosine; half that angle bends the
    // half vector, and alpha squared is twice the variance of the slope.
    return { axis: axes[k], flux, power, cosine, blur: (1 - cosine) / 2, pixels: group };
  });
}

/** The world's rotation of a light that is turned by `yaw` (to the right) and `pitch` (up). */
export function turn(yaw, pitch) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return new Matrix3().set(cy, sy * -sp, sy * cp, 0, cp, sp, -sy, cy * -sp, cy * cp);
}

/** `lights` of `merged` turned by `rotation`; shares: how much of each falls into which cell. */
export function turnedLights(lights, rotation) {
  return lights.map((light) => ({
    ...light,
    axis: light.axis.clone().applyMatrix3(rotation),
    shares: shares(light, rotation),
  }));
}

/** Shares of a turned light that fall into the cells of visibility: [[cell, share], ...]. */
function shares(light, rotation) {
  const sums = new Map();
  const at = new Vector3();
  for (const { towards, power } of light.pixels) {
    at.copy(towards).applyMatrix3(rotation);
    const row = (Math.acos(Math.min(1, Math.max(-1, at.y))) * ROWS) / Math.PI - 0.5;
    const column = (Math.atan2(at.x, -at.z) * COLUMNS) / (2 * Math.PI) - 0.5;
    for (const [i, rowShare] of neighbours(row))
      for (const [j, columnShare] of neighbours(column)) {
        const inside = Math.min(ROWS - 1, Math.max(0, i));
        const cell = inside * COLUMNS + ((j + 2 * COLUMNS) % COLUMNS);
        sums.set(cell, (sums.get(cell) ?? 0) + (power / light.power) * rowShare * columnShare);
      }
  }
  const kept = [...sums].filter(([, share]) => share > 0.004);
  const total = kept.reduce((sum, [, share]) => sum + share, 0);
  return kept.map(([cell, share]) => [cell, share / total]);
}

function neighbours(position) {
  const first = Math.floor(position);
  const fraction = position - first;
  return [
    [first, 1 - fraction],
    [first + 1, fraction],
  ];
}

/**
 * The irradiance of `lights` (of `turnedLights`) on each vertex, linear sRGB, written to `open`
 * without shadows and to `direct` with them.
 *
 * bits: Uint32Array, cell by cell, one bit per vertex. normals: Int16Array, unit as 32767.
 */
export function irradiance(lights, bits, normals, open, direct) {
  const words = bits.length / (ROWS * COLUMNS);
  const count = normals.length / 3;
  const seen = new Float32Array(words * 32); // share of a light that reaches each vertex
  open.fill(0);
  direct.fill(0);
  for (const light of lights) {
    seen.fill(0);
    for (const [cell, share] of light.shares) addWhereSet(bits, cell * words, words, share, seen);
    const [x, y, z] = [...light.axis].map((part) => (part * light.cosine) / 32767);
    const [red, green, blue] = light.flux;
    for (let vertex = 0, at = 0; vertex < count; vertex++, at += 3) {
      const cosine = normals[at] * x + normals[at + 1] * y + normals[at + 2] * z;
      if (cosine <= 0) continue;
      const reaching = cosine * seen[vertex];
      open[at] += cosine * red;
      open[at + 1] += cosine * green;
      open[at + 2] += cosine * blue;
      direct[at] += reaching * red;
      direct[at + 1] += reaching * green;
      direct[at + 2] += reaching * blue;
    }
  }
}

/** Add `value` to `sums[i]` wherever bit i of the `words` words of `bits` from `first` is set. */
function addWhereSet(bits, first, words, value, sums) {
  for (let w = 0; w < words; w++) {
    let word = bits[first + w];
    while (word) {
      const bit = 31 - Math.clz32(word);
      sums[32 * w + bit] += value;
      word ^= 1 << bit;
    }
  }
}
