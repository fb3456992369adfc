// The foot of a machine of ../foot.geo, on a floor of one block
Include "../foot.geo";
Box(3) = {-60,-50,-20, 120,100,20};
Physical Volume("FLOOR") = {3};
floor() = Boundary { Volume{3}; };
Physical Surface("UNDER") = floor(4);
Physical Surface("GROUND") = floor(5);
Transfinite Curve{ Boundary{ Surface{floor()}; } } = 2; Transfinite Surface{floor()}; Transfinite Volume{3};
