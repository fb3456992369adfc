// Half of a slice of a rubber seal, 4 mm in diameter; floor, wall and lid of one block each
r = 2; size = .28; t = .4;
a() = {-90, -40, -32, 32, 40, 90};
For i In {0:5}
  Point(i + 1) = {r * Cos(a(i) * Pi / 180), 0, r * Sin(a(i) * Pi / 180), size};
EndFor
Point(7) = {0, 0, 0, size};
For i In {1:5}
  Circle(i) = {i, 7, i + 1};
EndFor
Line(6) = {6, 7};
Line(7) = {7, 1};
Curve Loop(1) = {1:7};
Plane Surface(1) = {1};
Mesh.Algorithm = 6;
Mesh.SubdivisionAlgorithm = 1;
Recombine Surface{1};
slice[] = Extrude {0, t, 0} { Surface{1}; Layers{1}; Recombine; };
Physical Volume("rubber") = {slice[1]};
Physical Surface("below") = {slice[2]};
Physical Surface("beside") = {slice[4]};
Physical Surface("above") = {slice[6]};
Physical Surface("x0") = {slice[7], slice[8]};
Physical Surface("front") = {1};
Physical Surface("back") = {slice[0]};
// A block from x0 to x1 and z0 to z1
Macro Slab
  p = newp;
  Point(p) = {x0, -.1, z0}; Point(p + 1) = {x1, -.1, z0}; Point(p + 2) = {x1, -.1, z1}; Point(p + 3) = {x0, -.1, z1};
  l = newl;
  Line(l) = {p, p + 1}; Line(l + 1) = {p + 1, p + 2}; Line(l + 2) = {p + 2, p + 3}; Line(l + 3) = {p + 3, p};
  c = newll;
  Curve Loop(c) = {l, l + 1, l + 2, l + 3};
  s = news;
  Plane Surface(s) = {c};
  Transfinite Curve{l:l + 3} = 2;
  Transfinite Surface{s};
  Recombine Surface{s};
  made[] = Extrude {0, .6, 0} { Surface{s}; Layers{1}; Recombine; };
Return
x0 = -.5; x1 = 4; z0 = -3; z1 = -2;
Call Slab;
Physical Volume("floor") = {made[1]};
Physical Surface("floor_face") = {made[4]};
Physical Surface("floor_under") = {made[2]};
x0 = -.5; x1 = 4; z0 = 2; z1 = 3;
Call Slab;
Physical Volume("lid") = {made[1]};
Physical Surface("lid_face") = {made[2]};
Physical Surface("lid_top") = {made[4]};
x0 = 2.2; x1 = 3.2; z0 = -1.9; z1 = 1.1;
Call Slab;
Physical Volume("wall") = {made[1]};
Physical Surface("wall_face") = {made[5]};
Physical Surface("wall_back") = {made[3]};
