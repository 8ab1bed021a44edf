#version 330 core
// Which triangle it is, counted from 1, as red, green and blue: pyrender clears with 0.
out vec4 pixel;
void main() {
    int number = gl_PrimitiveID + 1;
    pixel = vec4(number >> 16, (number >> 8) & 255, number & 255, 255) / 255.0;
}
