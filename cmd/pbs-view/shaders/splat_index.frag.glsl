flat in uint id;
layout(location = 0) out uint colour;

void main() {
    colour = id;
}
