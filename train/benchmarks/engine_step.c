/* One step of many robots in many worlds in plain C: the fixed work that `warehouse bench --only reference` holds the
   simulator's step against. It does the same kind of work and no more: rear-steer motion, contact of rectangles with
   shelves and with each other, a lidar of 32 rays, the nearest robots, the way-points ahead, a reward for progress.

   Change nothing here: every ratio kept so far, and the release's, would no longer compare. Metres, radians, seconds;
   the pose is the front axle's. The floor is SIDE x SIDE cells of 1 m with shelves all round its rim. */

#include <math.h>
#include <stdint.h>

enum { SIDE = 46, RAYS = 32, NEAREST = 6, AHEAD = 5, POINTS = 64, SEEN = RAYS + 6 * NEAREST + 2 * AHEAD + 2 };

static const float HALF_LENGTH = 0.45f, HALF_WIDTH = 0.3f, TO_MIDDLE = 0.3f, RADIUS = 0.541f, WHEELBASE = 0.6f;
static const float RANGE = 6.0f, SUBSTEP = 0.05f, FASTEST = 1.5f, SLOWEST = -0.5f, STEEPEST = 1.047f, REACHED = 0.7f;

typedef struct {
    float x, y, heading, speed, steer; /* what moves */
    float cosine, sine;                /* of the heading */
    float middle_x, middle_y;          /* of the body */
    float reward;
    int32_t hit, passed; /* in contact in this step; way-points behind it */
} Robot;

static inline float least(float a, float b) { return a < b ? a : b; }
static inline float most(float a, float b) { return a > b ? a : b; }
static inline float within(float value, float low, float high) { return least(most(value, low), high); }

static inline void place(Robot *r)
{
    r->cosine = cosf(r->heading);
    r->sine = sinf(r->heading);
    r->middle_x = r->x - TO_MIDDLE * r->cosine;
    r->middle_y = r->y - TO_MIDDLE * r->sine;
}

static inline void move(Robot *r, float acceleration, float rate)
{
    for (int part = 0; part < 2; part++) {
        r->speed = within(r->speed + within(acceleration, -1.0f, 1.0f) * SUBSTEP, SLOWEST, FASTEST);
        r->steer = within(r->steer + 1.5f * within(rate, -1.0f, 1.0f) * SUBSTEP, -STEEPEST, STEEPEST);
        r->heading -= r->speed * tanf(r->steer) / WHEELBASE * SUBSTEP;
        r->x += r->speed * cosf(r->heading) * SUBSTEP;
        r->y += r->speed * sinf(r->heading) * SUBSTEP;
    }
    place(r);
}

/* Separating axes: a body and a cell whose centre lies (dx, dy) from its middle. */
static inline int on_cell(const Robot *r, float dx, float dy)
{
    float c = fabsf(r->cosine), s = fabsf(r->sine);
    return fabsf(dx) <= 0.5f + HALF_LENGTH * c + HALF_WIDTH * s && fabsf(dy) <= 0.5f + HALF_LENGTH * s + HALF_WIDTH * c
        && fabsf(dx * r->cosine + dy * r->sine) <= HALF_LENGTH + 0.5f * (c + s)
        && fabsf(dy * r->cosine - dx * r->sine) <= HALF_WIDTH + 0.5f * (c + s);
}

static inline int touch(const Robot *a, const Robot *b)
{
    float dx = b->middle_x - a->middle_x, dy = b->middle_y - a->middle_y;
    if (dx * dx + dy * dy > 4.0f * RADIUS * RADIUS)
        return 0;
    float c = fabsf(a->cosine * b->cosine + a->sine * b->sine), s = fabsf(a->cosine * b->sine - a->sine * b->cosine);
    float along = HALF_LENGTH + HALF_LENGTH * c + HALF_WIDTH * s, across = HALF_WIDTH + HALF_LENGTH * s + HALF_WIDTH * c;
    return fabsf(dx * a->cosine + dy * a->sine) <= along && fabsf(dy * a->cosine - dx * a->sine) <= across
        && fabsf(dx * b->cosine + dy * b->sine) <= along && fabsf(dy * b->cosine - dx * b->sine) <= across;
}

static int in_contact(const uint8_t *shelf, const Robot *world, int robots, int i)
{
    const Robot *r = world + i;
    int column = (int)r->middle_x, row = (int)r->middle_y;
    for (int v = row - 1; v <= row + 1; v++)
        for (int u = column - 1; u <= column + 1; u++) {
            int solid = u < 0 || v < 0 || u >= SIDE || v >= SIDE || shelf[v * SIDE + u];
            if (solid && on_cell(r, (float)u + 0.5f - r->middle_x, (float)v + 0.5f - r->middle_y))
                return 1;
        }
    for (int j = 0; j < robots; j++)
        if (j != i && touch(r, world + j))
            return 1;
    return 0;
}

/* Who is in contact goes back to where it was; a metre nearer to the next way-point is worth 1, a contact -1. */
static void settle(Robot *r, const Robot *before, const float *way)
{
    const float *point = way + 2 * r->passed;
    float old_x = point[0] - before->x, old_y = point[1] - before->y;
    r->reward = sqrtf(old_x * old_x + old_y * old_y);
    if (r->hit) {
        r->x = before->x, r->y = before->y, r->heading = before->heading, r->speed = 0.0f;
        place(r);
        r->reward -= 1.0f;
    }
    float dx = point[0] - r->x, dy = point[1] - r->y;
    r->reward -= sqrtf(dx * dx + dy * dy);
    while (r->passed < POINTS - 1 && dx * dx + dy * dy < REACHED * REACHED) {
        r->passed++;
        r->reward += 0.1f;
        dx = way[2 * r->passed] - r->x, dy = way[2 * r->passed + 1] - r->y;
    }
}

/* How far a ray is free of shelves, from cell to cell (Amanatides and Woo, 1987). */
static inline float free_of_shelves(const uint8_t *shelf, float x, float y, float dx, float dy)
{
    int column = (int)x, row = (int)y, right = dx > 0.0f ? 1 : -1, up = dy > 0.0f ? 1 : -1;
    float each_x = 1.0f / most(fabsf(dx), 1e-9f), each_y = 1.0f / most(fabsf(dy), 1e-9f);
    float next_x = (dx > 0.0f ? (float)(column + 1) - x : x - (float)column) * each_x;
    float next_y = (dy > 0.0f ? (float)(row + 1) - y : y - (float)row) * each_y;
    for (;;) {
        float at;
        if (next_x < next_y)
            at = next_x, next_x += each_x, column += right;
        else
            at = next_y, next_y += each_y, row += up;
        if (at >= RANGE)
            return RANGE;
        if (column < 0 || row < 0 || column >= SIDE || row >= SIDE || shelf[row * SIDE + column])
            return at;
    }
}

/* Shorten the rays that meet another's body: a test of slabs in its frame, without branches. */
static inline void shorten(float *restrict free, const float *restrict ray_x, const float *restrict ray_y,
                           const Robot *from, const Robot *other)
{
    float dx = from->middle_x - other->middle_x, dy = from->middle_y - other->middle_y;
    float c = other->cosine, s = other->sine, along = dx * c + dy * s, across = dy * c - dx * s;
    for (int k = 0; k < RAYS; k++) {
        float u = ray_x[k] * c + ray_y[k] * s, v = ray_y[k] * c - ray_x[k] * s;
        u = 1.0f / (fabsf(u) < 1e-9f ? 1e-9f : u);
        v = 1.0f / (fabsf(v) < 1e-9f ? 1e-9f : v);
        float back = (-HALF_LENGTH - along) * u, front = (HALF_LENGTH - along) * u;
        float right = (-HALF_WIDTH - across) * v, left = (HALF_WIDTH - across) * v;
        float enters = most(least(back, front), least(right, left)), leaves = least(most(back, front), most(right, left));
        float met = enters <= leaves && leaves > 0.0f ? most(enters, 0.0f) : RANGE;
        free[k] = least(free[k], met);
    }
}

static void tell_nearest(float *out, const Robot *r, const Robot *world, const int *nearest)
{
    for (int k = 0; k < NEAREST; k++, out += 6) {
        if (nearest[k] < 0) {
            for (int m = 0; m < 6; m++)
                out[m] = 0.0f;
            continue;
        }
        const Robot *other = world + nearest[k];
        float dx = other->middle_x - r->middle_x, dy = other->middle_y - r->middle_y;
        float vx = other->speed * other->cosine - r->speed * r->cosine, vy = other->speed * other->sine - r->speed * r->sine;
        out[0] = dx * r->cosine + dy * r->sine, out[1] = dy * r->cosine - dx * r->sine;
        out[2] = r->cosine * other->cosine + r->sine * other->sine;
        out[3] = r->cosine * other->sine - r->sine * other->cosine;
        out[4] = vx * r->cosine + vy * r->sine, out[5] = vy * r->cosine - vx * r->sine;
    }
}

static void observe(const uint8_t *shelf, const float *rays, const Robot *world, int robots, int i, const float *way,
                    float *restrict out)
{
    const Robot *r = world + i;
    float ray_x[RAYS], ray_y[RAYS], distance[NEAREST];
    int nearest[NEAREST];
    for (int k = 0; k < RAYS; k++) {
        ray_x[k] = r->cosine * rays[k] - r->sine * rays[RAYS + k];
        ray_y[k] = r->sine * rays[k] + r->cosine * rays[RAYS + k];
    }
    for (int k = 0; k < RAYS; k++)
        out[k] = free_of_shelves(shelf, r->middle_x, r->middle_y, ray_x[k], ray_y[k]);
    for (int k = 0; k < NEAREST; k++)
        distance[k] = (RANGE + RADIUS) * (RANGE + RADIUS), nearest[k] = -1;
    for (int j = 0; j < robots; j++) {
        float dx = world[j].middle_x - r->middle_x, dy = world[j].middle_y - r->middle_y, square = dx * dx + dy * dy;
        if (j == i || square > (RANGE + RADIUS) * (RANGE + RADIUS))
            continue;
        shorten(out, ray_x, ray_y, r, world + j);
        int k = NEAREST;
        for (; k > 0 && distance[k - 1] > square; k--)
            if (k < NEAREST)
                distance[k] = distance[k - 1], nearest[k] = nearest[k - 1];
        if (k < NEAREST)
            distance[k] = square, nearest[k] = j;
    }
    tell_nearest(out + RAYS, r, world, nearest);
    float *ahead = out + RAYS + 6 * NEAREST;
    for (int k = 0; k < AHEAD; k++, ahead += 2) {
        const float *point = way + 2 * (r->passed + k < POINTS ? r->passed + k : POINTS - 1);
        float dx = point[0] - r->x, dy = point[1] - r->y;
        ahead[0] = dx * r->cosine + dy * r->sine, ahead[1] = dy * r->cosine - dx * r->sine;
    }
    ahead[0] = r->speed, ahead[1] = r->steer;
}

/* shelf [SIDE][SIDE], rays [2][RAYS], robot [worlds][robots], before alike, way [worlds][robots][POINTS][2],
   command [worlds][robots][2] of acceleration and steering rate in [-1, 1], seen [worlds][robots][SEEN]. */
void step(int64_t worlds, int64_t robots, const uint8_t *shelf, const float *rays, Robot *robot, Robot *before,
          const float *way, const float *command, float *seen)
{
    for (int64_t b = 0; b < worlds; b++) {
        Robot *world = robot + b * robots, *old = before + b * robots;
        const float *ways = way + b * robots * POINTS * 2;
        for (int i = 0; i < robots; i++) {
            old[i] = world[i];
            move(world + i, command[2 * (b * robots + i)], command[2 * (b * robots + i) + 1]);
        }
        for (int i = 0; i < robots; i++)
            world[i].hit = in_contact(shelf, world, (int)robots, i);
        for (int i = 0; i < robots; i++)
            settle(world + i, old + i, ways + i * POINTS * 2);
        for (int i = 0; i < robots; i++)
            observe(shelf, rays, world, (int)robots, i, ways + i * POINTS * 2, seen + (b * robots + i) * SEEN);
    }
}
