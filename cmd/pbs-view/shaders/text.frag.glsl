// Text and what it stands on, in one colour.

uniform vec4 ink; // linear

out vec4 colour;

void main() {
    colour = ink;
}
