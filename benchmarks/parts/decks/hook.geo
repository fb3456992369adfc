// The hook of ../hook.geo over a pin, tube of radii 10 and 19.7, 0.2 below its centre
Include "../hook.geo";
Cylinder(50) = {0,-.2,-2, 0,0,16, 19.7};
Cylinder(51) = {0,-.2,-3, 0,0,18, 10};
BooleanDifference(52) = { Volume{50}; Delete; }{ Volume{51}; Delete; };
Physical Volume("pin") = {52};
skin() = Boundary { Volume{52}; };
Physical Surface("core") = Surface In BoundingBox {-10.1,-10.3,-2.1,10.1,10,14.1};
Physical Surface("round") = skin(0);
