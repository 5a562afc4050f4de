// Positions, normals and tangents are in the world frame of scene/camera.py, centimetres.
uniform mat4 projectionMatrix;
uniform mat4 viewMatrix;
uniform vec3 low;
uniform vec3 extent;

in vec3 position;
in vec3 normal;
in vec4 tangent;
in vec2 uv;
in vec3 clear;
in vec3 open;
in vec3 direct;
in float hidden;

out vec3 vPosition;
out vec3 vNormal;
out vec4 vTangent;
out vec2 vUv;
out vec3 vClear;
out vec3 vOpen;
out vec3 vDirect;
out float vHidden;

void main() {
  vPosition = low + extent * position;
  vNormal = normal;
  vTangent = tangent;
  vUv = uv;
  vClear = clear;
  vOpen = open;
  vDirect = direct;
  vHidden = hidden;
  gl_Position = projectionMatrix * viewMatrix * vec4(vPosition, 1.0);
}
