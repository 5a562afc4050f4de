// The reflectance of scene/brdf.py: Lambert plus one Beckmann lobe, index of refraction 1.38,
// separate normals. The light is a sum of LIGHTS spherical Gaussians.
precision highp float;

uniform vec4 axis[LIGHTS];  // direction; in w, what the light's width adds to alpha squared
uniform vec4 flux[LIGHTS];  // radiance times solid angle, linear sRGB; in w, the mean cosine
uniform vec3 eye;
uniform float exposure;
uniform sampler2D diffuseAlbedo;
uniform sampler2D material;  // specular albedo / 2, square root of alpha, confidence
uniform sampler2D specularNormal;
uniform sampler2D diffuseNormal;

// Switches: 1 as measured, 0 off or a plain value.
uniform float useDiffuseAlbedo;
uniform float useSpecularAlbedo;
uniform float useRoughness;
uniform float useSpecularNormal;
uniform float useDiffuseNormal;
uniform float useDiffuse;
uniform float useSpecular;
uniform float useShadow;
uniform float onlyMeasured;

in vec3 vPosition;
in vec3 vNormal;
in vec4 vTangent;
in vec2 vUv;
in vec3 vOpen;  // irradiance on the mesh without shadows
in vec3 vDirect;  // the same with shadows
in float vHidden;  // share of the sky that the head hides

out vec4 colour;

const float PI = 3.14159265358979;
const float IOR = 1.38;

// Exact for a dielectric, unpolarised; both terms over one divisor.
float fresnel(float cosine) {
  float root = sqrt(cosine * cosine + (IOR * IOR - 1.0));
  float straight = IOR * IOR * cosine;
  float across = (cosine - root) * (root + straight), along = (root - straight) * (cosine + root);
  float whole = (cosine + root) * (root + straight);
  return 0.5 * (across * across + along * along) / (whole * whole);
}

// Walter et al. 2007, equation 27.
float smith(float cosine, float alpha2) {
  float a = cosine * inversesqrt(alpha2 * max(1.0 - cosine * cosine, 1e-12));
  return a >= 1.6 ? 1.0 : a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a));
}

// D F G1 of a light, without what is the same for all lights: G1 of the viewer / (4 pi cosO).
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

// A normal map's direction in the world: MikkTSpace, y up.
vec3 bent(sampler2D map, float use) {
  vec3 local = mix(vec3(0.0, 0.0, 1.0), 2.0 * texture(map, vUv).xyz - 1.0, use);
  vec3 across = sign(vTangent.w) * cross(vNormal, vTangent.xyz);
  return normalize(local.x * vTangent.xyz + local.y * across + local.z * vNormal);
}

vec3 encoded(vec3 linear) {
  linear = clamp(linear, 0.0, 1.0);
  return mix(12.92 * linear, 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055,
             step(0.0031308, linear));
}

void main() {
  vec3 look = texture(material, vUv).xyz;
  if (onlyMeasured > 0.5 && look.z < 0.7) discard;
  vec3 rhoD = mix(vec3(0.5), texture(diffuseAlbedo, vUv).xyz, useDiffuseAlbedo);
  float rhoS = mix(1.0, 2.0 * look.x, useSpecularAlbedo);
  float alpha = mix(0.3, look.y * look.y, useRoughness);
  float alpha2 = alpha * alpha;
  vec3 nD = bent(diffuseNormal, useDiffuseNormal);
  vec3 nS = bent(specularNormal, useSpecularNormal);
  vec3 viewer = normalize(eye - vPosition);
  float cosO = max(dot(nS, viewer), 1e-4);

  vec3 e = vec3(0.0), s = vec3(0.0);
#define LIGHT(k) \
  e += max(dot(nD, axis[k].xyz), 0.0) * flux[k].w * flux[k].xyz; \
  s += gloss(axis[k], nS, viewer, cosO, alpha2) * flux[k].xyz;
  EVERY_LIGHT
  // Shadows and what hides the sky are known for the mesh's normal; in place of the hidden sky
  // stands skin that is lit like this point without shadows.
  vec3 reaching = mix(vec3(1.0), vDirect / max(vOpen, 1e-4), useShadow);
  e *= reaching + useShadow * vHidden * rhoD;
  s *= reaching * smith(cosO, alpha2) / (4.0 * cosO);
  vec3 radiance = (useDiffuse * rhoD * e + useSpecular * rhoS * s) / PI;
  colour = vec4(encoded(exposure * radiance), 1.0);
}
