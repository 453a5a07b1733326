/* The walk of warehouse_env/planning/ants/colony.py in plain C: what `warehouse bench` holds the compiled Python against.

   The same random numbers (xorshift64, one generator an ant) and the same order of additions, so the same moves.
   Tables are [cells][8], moves [ants][cells]; steps -1: the ant did not arrive. */

#include <stdint.h>

static double weigh(const int32_t *neighbour, const double *trail, const double *turning, const double *straight,
                    const int64_t *visited, int64_t tabu, int heading, double *chance)
{
    double total = 0.0;
    for (int move = 0; move < 8; move++) {
        chance[move] = 0.0;
        if (visited[neighbour[move]] != tabu) {
            chance[move] = trail[move] * (move == heading ? straight[move] : turning[move]);
            total += chance[move];
        }
    }
    if (total > 0.0)
        return total;
    total = 0.0; /* a dead end, or all weights underflow */
    for (int move = 0; move < 8; move++) {
        chance[move] = visited[neighbour[move]] != tabu ? 1.0 : 0.0;
        total += chance[move];
    }
    return total;
}

static int largest(const double *chance)
{
    int best = 0;
    for (int move = 1; move < 8; move++)
        if (chance[move] > chance[best])
            best = move;
    return best;
}

static int spin(const double *chance, double left)
{
    int chosen = 0;
    for (int move = 0; move < 8; move++) {
        if (chance[move] > 0.0) {
            chosen = move;
            left -= chance[move];
            if (left < 0.0)
                break;
        }
    }
    return chosen;
}

void walk(int64_t cells, int64_t ants, const int32_t *neighbour, int64_t goal, double *trail, const double *turning,
          const double *straight, const uint64_t *seeds, double q0, int backtrack, double decay, double level,
          int64_t *visited, int64_t stamp, const int64_t *start, int8_t *all_moves, int64_t *all_steps)
{
    for (int64_t ant = 0; ant < ants; ant++) {
        int8_t *moves = all_moves + ant * cells;
        uint64_t random = seeds[ant];
        int64_t tabu = stamp + ant, cell = start[ant], steps = 0;
        int heading = -1;
        if (cell < 0) {
            all_steps[ant] = -1;
            continue;
        }
        visited[cell] = tabu;
        while (cell != goal) {
            double chance[8];
            int64_t at = 8 * cell;
            double total = weigh(neighbour + at, trail + at, turning + at, straight + at, visited, tabu, heading, chance);
            if (total == 0.0) {
                if (!backtrack || steps == 0) {
                    steps = -1;
                    break;
                }
                steps--;
                cell = neighbour[8 * cell + (moves[steps] + 4) % 8];
                heading = steps > 0 ? moves[steps - 1] : -1;
                continue;
            }
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            double draw = (double)(random >> 11) * 0x1p-53;
            if (draw < q0) {
                heading = largest(chance);
            } else {
                if (q0 > 0.0)
                    draw = (draw - q0) / (1.0 - q0);
                heading = spin(chance, draw * total);
            }
            if (decay > 0.0)
                trail[at + heading] += decay * (level - trail[at + heading]);
            moves[steps++] = (int8_t)heading;
            cell = neighbour[at + heading];
            visited[cell] = tabu;
        }
        all_steps[ant] = steps;
    }
}
