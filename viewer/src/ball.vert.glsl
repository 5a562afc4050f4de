// One triangle that covers the picture.
in vec3 position;

out vec2 vPlace;

void main() {
  vPlace = 0.5 + 0.5 * position.xy;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}
