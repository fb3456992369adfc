// A tread block with rounded edges, millimetres: a profile in x and z, drawn along y.
//     gmsh -3 tread_block.geo
r = 2; l = 30; w = 16; h = 12; size = 2.0;
Point(1) = {0, 0, h, size};
Point(2) = {0, 0, r, size};
Point(3) = {r, 0, r, size};
Point(4) = {r, 0, 0, size};
Point(5) = {l - r, 0, 0, size};
Point(6) = {l - r, 0, r, size};
Point(7) = {l, 0, r, size};
Point(8) = {l, 0, h, size};
Line(1) = {1, 2};
Circle(2) = {2, 3, 4};
Line(3) = {4, 5};
Circle(4) = {5, 6, 7};
Line(5) = {7, 8};
Line(6) = {8, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Plane Surface(1) = {1};
Mesh.Algorithm = 6;
Mesh.RecombinationAlgorithm = 1;
Recombine Surface{1};
Mesh.MshFileVersion = 4.1;
block[] = Extrude {0, w, 0} { Surface{1}; Layers{4}; Recombine; };
Physical Volume("rubber") = {block[1]};
Physical Surface("tread") = {block[2], block[3], block[4], block[5], block[6]};
Physical Surface("carcass") = {block[7]};
