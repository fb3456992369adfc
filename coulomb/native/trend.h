/* How much work sweeps have left, from the trend of the smallest residual over all but the first part of their work: it
   falls in jumps, and from one look to the next it may not fall at all. */

#include <math.h>

#define MARKS 200
#define APART 1.1 /* ratio of the work at two marks */
#define EARLY 0.2 /* part of the work after which the trend begins */

/* The smallest residual so far, at the end and at marks of the work. */
struct trend {
    double smallest, at[MARKS], spent[MARKS];
    int first, count;
};

/* Work that is left until the residual is at most tolerance, at the trend of its smallest value; 0 if not yet known. */
static double work_left(struct trend *t, double size, double tolerance, double spent)
{
    t->smallest = t->count > 0 ? fmin(t->smallest, size) : size;
    if (t->count == 0 || (t->count < MARKS && spent >= APART * t->spent[t->count - 1]))
        t->at[t->count] = t->smallest, t->spent[t->count++] = spent;
    while (t->first + 1 < t->count && t->spent[t->first + 1] <= EARLY * spent)
        t->first++;
    if (t->spent[t->first] > EARLY * spent)
        return 0.0;
    const double gained = log(t->at[t->first] / t->smallest);
    return gained > 0.0 ? log(t->smallest / tolerance) / gained * (spent - t->spent[t->first]) : 1e300;
}
