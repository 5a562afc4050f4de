// The reflectance of scene/brdf.py: one Beckmann lobe, index of refraction 1.38.
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
