SetFactory("OpenCASCADE");
// hook: 200 degrees of a ring, inner radius 20, outer 28, width 12, with a straight shank of 40
Point(1)={0,0,0};
a0=-Pi/2-1.75; a1=0;
Point(10)={20*Cos(a0),20*Sin(a0),0}; Point(11)={28*Cos(a0),28*Sin(a0),0};
Point(12)={20*Cos(a0/2),20*Sin(a0/2),0}; Point(13)={28*Cos(a0/2),28*Sin(a0/2),0};
Point(14)={20,0,0}; Point(15)={28,0,0}; Point(16)={20,40,0}; Point(17)={28,40,0};
Circle(1)={10,1,12}; Circle(2)={12,1,14}; Line(3)={14,16}; Line(4)={16,17}; Line(5)={17,15}; Circle(6)={15,1,13}; Circle(7)={13,1,11}; Line(8)={11,10};
Curve Loop(1)={1,2,3,4,5,6,7,8}; Plane Surface(1)={1};
o[]=Extrude{0,0,12}{Surface{1};};
Physical Volume("steel")={o[1]};
Physical Surface("inner")={o[2],o[3]};
Physical Surface("shank")={o[5]};
Physical Surface("tip")={o[9]};
Mesh.MeshSizeMax = 2.5; Mesh.MeshSizeMin=1;
