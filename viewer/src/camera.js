// The photo's pinhole camera, and how it is taken round the head.

import { PerspectiveCamera } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const NEAR = 5; // cm
const FAR = 1000;
const DEGREES = 180 / Math.PI;

/** three.js's camera for the crop's pinhole of scene/camera.py; its window need not be centred. */
function pinhole({ size, focal, cx, cy }) {
  const camera = new PerspectiveCamera();
  const edge = (pixels) => (NEAR * pixels) / focal;
  const [left, right, top, bottom] = [-cx, size - cx, cy, cy - size].map(edge);
  camera.projectionMatrix.makePerspective(left, right, top, bottom, NEAR, FAR);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  return camera;
}

export class Orbit {
  /**
   * The photo's camera (`crop`), turned about `middle`, the middle of the head; `changed` is
   * called when it has moved.
   *
   * The controls move a proxy that looks at the origin. The camera itself need not look at the
   * head (a crop may lie anywhere in the photo), so it copies the proxy's turn and distance.
   */
  constructor(crop, canvas, middle, changed) {
    this.camera = pinhole(crop);
    this.middle = middle;
    this.distance = middle.length();
    this.proxy = new PerspectiveCamera();
    this.controls = new OrbitControls(this.proxy, canvas);
    this.controls.enablePan = false;
    canvas.style.touchAction = "pan-y"; // a finger that moves up or down scrolls the page
    this.controls.minDistance = 0.3 * this.distance;
    this.controls.maxDistance = 2 * this.distance;
    this.controls.addEventListener("change", () => {
      this.follow();
      changed();
    });
    this.reset();
  }

  /** Back to where the photo was taken from. */
  reset() {
    this.proxy.position.set(0, 0, this.distance);
    this.controls.update();
  }

  /** Go round by angles in radians; `closer` divides the distance. */
  move(right, up, closer = 1) {
    const { position } = this.proxy;
    const distance = position.length();
    const azimuth = Math.atan2(position.x, position.z) + right;
    const elevation = Math.asin(position.y / distance) + up;
    const height = Math.min(1.55, Math.max(-1.55, elevation));
    position
      .set(Math.sin(azimuth) * Math.cos(height), Math.sin(height), Math.cos(azimuth) * Math.cos(height))
      .multiplyScalar(distance / closer);
    this.controls.update();
  }

  /** Stand `azimuth` radians to the right of the photo's camera, as high and far as now. */
  face(azimuth) {
    this.move(azimuth - this.azimuth(), 0);
  }

  /** Radians to the right of the photo's camera. */
  azimuth() {
    return Math.atan2(this.proxy.position.x, this.proxy.position.z);
  }

  follow() {
    const { quaternion, position } = this.proxy;
    this.camera.quaternion.copy(quaternion);
    this.camera.position
      .copy(this.middle)
      .multiplyScalar(-position.length() / this.distance)
      .applyQuaternion(quaternion)
      .add(this.middle);
    this.camera.updateMatrixWorld();
  }

  /** Degrees the camera stands to the right of the photo's, and above it. */
  angles() {
    const { x, y, z } = this.proxy.position;
    return [Math.atan2(x, z), Math.asin(y / Math.hypot(x, y, z))].map((a) => Math.round(a * DEGREES));
  }
}
