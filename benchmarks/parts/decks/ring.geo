// The half ring of ../ring.geo on a floor of one block
Include "../ring.geo";
Box(50) = {-60,-10,-58, 120,35,10};
Physical Volume("FLOOR") = {50};
floor() = Boundary { Volume{50}; };
Physical Surface("UNDER") = floor(4);
Physical Surface("GROUND") = floor(5);
Transfinite Curve{ Boundary{ Surface{floor()}; } } = 2; Transfinite Surface{floor()}; Transfinite Volume{50};
