// The face: our reflectance (brdf.glsl) with separate normals for its two terms, under the light
// that is collected in the balls (ball.glsl).
uniform sampler2D balls;
uniform mat3 toBall;  // from the world: x right, y up, z to the viewer
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
in vec3 vClear;  // normal of the cornea, 0 where there is none
in vec3 vOpen;  // irradiance on the mesh without shadows
in vec3 vDirect;  // the same with shadows
in float vHidden;  // share of the sky that the head hides

out vec4 colour;

// The ball of this number, 0 to BALLS - 1, at the normal `n` of the world.
vec3 reflected(float ball, vec3 n) {
  vec2 place = 0.5 + 0.5 * onBall(toBall * n);
  return texture(balls, vec2((ball + place.x) / BALLS, place.y)).xyz;
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

// What a cornea with this normal reflects, as sharply as the balls can: those of alpha .1.
vec3 clearly(vec3 n, vec3 nearer, vec3 viewer) {
  float cosO = max(dot(n, viewer), 1e-4);
  vec3 seen = normalize(n - nearer / (2.0 * max(cosO, 0.5)));
  return reflected(1.0, seen) / 0.01 * smith(cosO, 0.01) / (4.0 * cosO);
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
  float facing = dot(nS, viewer);
  float cosO = max(facing, 1e-4);

  vec3 e = reflected(0.0, nD);
  // The balls are seen from afar. From nearer the viewer's direction differs, and by half as much
  // the direction between viewer and light, on which the gloss depends.
  vec3 afar = vec3(0.0, 0.0, 1.0) * toBall;
  vec3 seen = normalize(nS + (afar - viewer) / (2.0 * max(cosO, 0.5)));
  float ball = clamp(10.0 * alpha, 1.0, BALLS - 1.0);
  float lower = min(floor(ball), BALLS - 2.0);
  vec3 s = mix(reflected(lower, seen), reflected(lower + 1.0, seen), ball - lower) / alpha2;
  // Shadows and what hides the sky are known for the mesh's normal; in place of the hidden sky
  // stands skin that is lit like this point without shadows.
  vec3 reaching = mix(vec3(1.0), vDirect / max(vOpen, 1e-4), useShadow);
  e *= reaching + useShadow * vHidden * rhoD;
  // The ball ends at a right angle to the viewer: beyond it, and a little before, rims would glitter.
  s *= smoothstep(0.0, 0.2, facing) * reaching * smith(cosO, alpha2) / (4.0 * cosO);
  s *= rhoS;
  if (dot(vClear, vClear) > 0.25) s += reaching * clearly(normalize(vClear), viewer - afar, viewer);
  vec3 radiance = (useDiffuse * rhoD * e + useSpecular * s) / PI;
  colour = vec4(encoded(exposure * radiance), 1.0);
}
