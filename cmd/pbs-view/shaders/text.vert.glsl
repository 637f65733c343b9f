// Lines of text and what they stand on, in pixels from the left upper corner.

layout(location = 0) in vec2 position;

uniform vec2 size; // of the canvas

void main() {
    gl_Position = vec4(2.0 * position.x / size.x - 1.0, 1.0 - 2.0 * position.y / size.y, 0.5, 1.0);
}
