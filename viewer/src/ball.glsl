// Balls of several materials, seen by the camera and lit by the whole light, side by side in one
// small picture: a diffuse one, then one for each roughness of 0.1, 0.2, 0.3 and 0.4. The head
// looks up in them what a surface with its normal reflects. A ball's normals are drawn by
// Lambert's equal-area projection, a little beyond what the camera would see of it.
const float BALLS = 5.0;
const float REACH = 1.1;  // of the projection; 1 is a right angle to the viewer

// The place of a unit normal (x right, y up, z to the viewer) on its ball, -1 to 1.
vec2 onBall(vec3 n) {
  vec2 place = n.xy * inversesqrt(1.0 + max(n.z, -0.5)) / REACH;
  return place * min(1.0, 0.95 * inversesqrt(max(dot(place, place), 1e-6)));
}

vec3 fromBall(vec2 place) {
  place *= REACH;
  float z = 1.0 - dot(place, place);
  return vec3(place * sqrt(max(1.0 + z, 0.0)), z);
}
