// Draws the balls (ball.glsl) under a sum of LIGHTS spherical Gaussians.
uniform vec4 axis[LIGHTS];  // direction; in w, what the light's width adds to alpha squared
uniform vec4 flux[LIGHTS];  // radiance times solid angle, linear sRGB; in w, the mean cosine
uniform mat3 toBall;  // from the world: x right, y up, z to the viewer

in vec2 vPlace;

out vec4 colour;

// D F G1 of a light; see reflected.
float gloss(vec4 light, vec3 n, vec3 viewer, float cosO, float alpha2) {
  float cosI = dot(n, light.xyz);
  float both = 1.0 + dot(viewer, light.xyz);  // of unit vectors: 2 both is |sum| squared
  float cosH = max((cosI + cosO) * inversesqrt(2.0 * both + 1e-6), 1e-4);
  float secant2 = 1.0 / (cosH * cosH);
  float width = 1.0 / (alpha2 + light.w);
  float beckmann = exp((1.0 - secant2) * width) * secant2 * secant2 * width;
  float lobe = beckmann * fresnel(sqrt(0.5 * both)) * smith(cosI, alpha2);
  return cosI > 0.0 ? lobe : 0.0;
}

void main() {
  float ball = floor(vPlace.x * BALLS);
  vec3 n = fromBall(2.0 * vec2(fract(vPlace.x * BALLS), vPlace.y) - 1.0) * toBall;
  vec3 viewer = vec3(0.0, 0.0, 1.0) * toBall;
  float alpha2 = 0.01 * ball * ball;
  float cosO = max(dot(n, viewer), 1e-4);
  vec3 sum = vec3(0.0);
  if (ball < 0.5) {
#define LIGHT(k) sum += max(dot(n, axis[k].xyz), 0.0) * flux[k].w * flux[k].xyz;
    EVERY_LIGHT
#undef LIGHT
  } else {
#define LIGHT(k) sum += gloss(axis[k], n, viewer, cosO, alpha2) * flux[k].xyz;
    EVERY_LIGHT
#undef LIGHT
    sum *= alpha2;  // so that it changes little from ball to ball
  }
  colour = vec4(sum, 1.0);
}
