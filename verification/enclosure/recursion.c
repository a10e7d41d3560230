/* A set carried from sample to sample, rigorous: every interval is rounded outwards.

   A program is a list of operations on intervals, arguments first. Evaluated on a box it gives for every operation an
   interval that holds its values and, by every coordinate that it depends on, one that holds its slopes. Compile
   without contraction of products and sums, and run in rounding to nearest with subnormal numbers. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#if !defined(FLT_EVAL_METHOD) || FLT_EVAL_METHOD != 0
#error "doubles must be computed as doubles"
#endif

enum {
    INPUT, CONSTANT, ADD, SUB, MUL, DIV, NEG, INV, TWICE, SQ, SQRT, FABS, FMIN, FMAX, SIGN, FLOOR, CEIL, LT, LE, EQ,
    NE, NOT, AND, OR, IF_ELSE_ZERO, SELECT, COVER, MEET, WHOLE_POWER, COPYSIGN, ASKED
};

typedef struct { double lo, hi; } span;

/* What is asked of the caller: an operation, the ends of its arguments; value, slopes by the arguments, and last
   HOLDS where they do. Whoever comes back without an answer has said that nothing is known. */
typedef void (*asking)(int node, const double *arguments, double *answer);
enum { ANSWERS = 7 };
#define HOLDS 1.0

/* What a goal of a program takes: its node, and the operations that it needs, in order. */
typedef struct { int node, count; const int *list; } goal;

typedef struct {
    int nodes, coordinates, readings, inner;
    const goal *within;             /* functions of one coordinate, whose ranges are the last coordinates of a box */
    const int *op, *a, *b, *c;      /* operation and arguments by node */
    const span *number;             /* of a constant; of a power its exponent */
    const uint64_t *depends;        /* by node: the coordinates that it depends on */
    asking ask;
    span *value, *slope;            /* by node; by node and coordinate */
    char *fault;
} program;

static const double INF = INFINITY;
static const span ALL = {-INFINITY, INFINITY}, NOTHING = {0.0, 0.0}, UNIT = {1.0, 1.0};

static double above(double x) {
    int64_t bits;
    if (!(x < INF)) return x; /* infinite, or no number */
    if (x == 0) return 0x1p-1074;
    memcpy(&bits, &x, sizeof x);
    bits += x > 0 ? 1 : -1;
    memcpy(&x, &bits, sizeof x);
    return x;
}
static double below(double x) { return -above(-x); }
static double larger(double x, double y) { return x > y ? x : y; }
static double smaller(double x, double y) { return x < y ? x : y; }

static span known(span x) {
    if (isnan(x.lo)) x.lo = -INF;
    if (isnan(x.hi)) x.hi = INF;
    return x;
}

/* The error of a rounded sum where it is known exactly; elsewhere both ends are moved. */
static double sum_down(double x, double y) {
    double s = x + y, t = s - x, e = (x - (s - t)) + (y - t);
    return fabs(s) < 0x1p1000 && fabs(x) < 0x1p1000 && e >= 0 ? s : below(s);
}
static double sum_up(double x, double y) {
    double s = x + y, t = s - x, e = (x - (s - t)) + (y - t);
    return fabs(s) < 0x1p1000 && fabs(x) < 0x1p1000 && e <= 0 ? s : above(s);
}
static double product_error(double x, double y, double p) {
    double size = fabs(p), sx = 134217729.0 * x, sy = 134217729.0 * y, hx, hy, lx, ly;
    if (!(size > 0x1p-900 && size < 0x1p990 && fabs(x) < 0x1p990 && fabs(y) < 0x1p990)) return NAN;
    hx = sx - (sx - x), hy = sy - (sy - y), lx = x - hx, ly = y - hy;
    return ((hx * hy - p) + hx * ly + lx * hy) + lx * ly;
}
static double product_down(double x, double y) {
    double p, e;
    if (x == 0 || y == 0) return 0.0;
    p = x * y, e = product_error(x, y, p);
    return e >= 0 ? p : below(p);
}
static double product_up(double x, double y) {
    double p, e;
    if (x == 0 || y == 0) return 0.0;
    p = x * y, e = product_error(x, y, p);
    return e <= 0 ? p : above(p);
}
static double quotient_down(double x, double y) {
    double q = x / y;
    if (x == 0 || isnan(q)) return 0.0; /* both infinite: the other end bounds the quotient */
    return q * y == x && product_error(q, y, x) == 0 ? q : below(q);
}
static double quotient_up(double x, double y) {
    double q = x / y;
    if (x == 0 || isnan(q)) return 0.0;
    return q * y == x && product_error(q, y, x) == 0 ? q : above(q);
}

static span add(span x, span y) { span r = {sum_down(x.lo, y.lo), sum_up(x.hi, y.hi)}; return r; }
static span neg(span x) { span r = {-x.hi, -x.lo}; return r; }
static span sub(span x, span y) { return add(x, neg(y)); }
static span hull(span x, span y) { span r = {smaller(x.lo, y.lo), larger(x.hi, y.hi)}; return r; }
static span meet(span x, span y) { span r = {larger(x.lo, y.lo), smaller(x.hi, y.hi)}; return r; }
static int holds_zero(span x) { return x.lo <= 0 && x.hi >= 0; }

static span mul(span x, span y) {
    span r;
    if (x.lo >= 0) {
        r.lo = y.lo >= 0 ? product_down(x.lo, y.lo) : product_down(x.hi, y.lo);
        r.hi = y.hi >= 0 ? product_up(x.hi, y.hi) : product_up(x.lo, y.hi);
        if (y.lo >= 0 && !(r.lo >= 0)) r.lo = 0;
    } else if (x.hi <= 0) {
        r.lo = y.hi <= 0 ? product_down(x.hi, y.hi) : product_down(x.lo, y.hi);
        r.hi = y.lo >= 0 ? product_up(x.hi, y.lo) : product_up(x.lo, y.lo);
    } else if (y.lo >= 0) {
        r.lo = product_down(x.lo, y.hi), r.hi = product_up(x.hi, y.hi);
    } else if (y.hi <= 0) {
        r.lo = product_down(x.hi, y.lo), r.hi = product_up(x.lo, y.lo);
    } else {
        r.lo = smaller(product_down(x.lo, y.hi), product_down(x.hi, y.lo));
        r.hi = larger(product_up(x.lo, y.lo), product_up(x.hi, y.hi));
    }
    return r;
}

static span over(span x, span y) { /* ALL where the divisor may be zero */
    span r;
    if (holds_zero(y)) return ALL;
    if (y.hi < 0) x = neg(x), y = neg(y);
    r.lo = quotient_down(x.lo, x.lo >= 0 ? y.hi : y.lo);
    r.hi = quotient_up(x.hi, x.hi >= 0 ? y.lo : y.hi);
    if (x.lo >= 0 && !(r.lo >= 0)) r.lo = 0;
    return r;
}

static span magnitude(span x) {
    double low = fabs(x.lo), high = fabs(x.hi);
    span r = {holds_zero(x) ? 0.0 : smaller(low, high), larger(low, high)};
    return r;
}

static span square(span x) {
    span m = magnitude(x), r = {product_down(m.lo, m.lo), product_up(m.hi, m.hi)};
    if (!(r.lo >= 0)) r.lo = 0;
    return r;
}

static int exact_root(double x, double root) { return root * root == x && product_error(root, root, x) == 0; }
static span root(span x) { /* of what is not negative */
    span r = {sqrt(x.lo), sqrt(x.hi)};
    if (x.lo != 0 && !exact_root(x.lo, r.lo)) r.lo = below(r.lo);
    if (x.hi != 0 && !exact_root(x.hi, r.hi)) r.hi = above(r.hi);
    if (!(r.lo >= 0)) r.lo = 0;
    return r;
}

static span power_of_size(span x, int n) { /* of what is not negative, n > 0 */
    span r = UNIT;
    int i;
    for (i = 0; i < n; i++) r.lo = product_down(r.lo, x.lo), r.hi = product_up(r.hi, x.hi);
    if (!(r.lo >= 0)) r.lo = 0;
    return known(r);
}
static span whole_power(span x, int n) { /* n > 0 */
    span low, high, m;
    if (n % 2 == 0) return power_of_size(magnitude(x), n);
    m.lo = m.hi = fabs(x.lo), low = power_of_size(m, n);
    m.lo = m.hi = fabs(x.hi), high = power_of_size(m, n);
    if (x.lo < 0) low = neg(low);
    if (x.hi < 0) high = neg(high);
    m.lo = low.lo, m.hi = high.hi;
    return m;
}

static span truth(span x) {
    span r = {!holds_zero(x), !(x.lo == 0 && x.hi == 0)};
    return r;
}
static span less(span x, span y) { span r = {x.hi < y.lo, x.lo < y.hi}; return r; }
static span less_equal(span x, span y) { span r = {x.hi <= y.lo, x.lo <= y.hi}; return r; }
static span equal(span x, span y) { span r = {x.lo == y.hi && x.hi == y.lo, x.lo <= y.hi && y.lo <= x.hi}; return r; }
static span negation(span x) { span r = {1.0 - x.hi, 1.0 - x.lo}; return r; }
static span signs(span x) { span r = {(x.lo > 0) - (x.lo < 0), (x.hi > 0) - (x.hi < 0)}; return r; }

static span slope_of(const program *p, int node, int coordinate) {
    return p->depends[node] >> coordinate & 1 ? p->slope[(size_t)node * p->coordinates + coordinate] : NOTHING;
}
/* A slope times the slope of what is made of it, which is mostly 0 or 1. */
static span chained(span g, span by) {
    if (by.lo == 1 && by.hi == 1) return g;
    if ((by.lo == 0 && by.hi == 0) || (g.lo == 0 && g.hi == 0)) return NOTHING;
    if (by.lo == -1 && by.hi == -1) return neg(g);
    return known(g.lo == 1 && g.hi == 1 ? by : mul(g, by));
}

/* Evaluate some operations of a program, in order, on a box of coordinates and readings. */
static void evaluate(const program *p, const int *list, int count, const span *box, const span *readings, int slopes) {
    int n = p->coordinates, at, i;
    for (at = 0; at < count; at++) {
        int k = list[at], op = p->op[k], bad = 0, a = p->a[k], b = p->b[k], c = p->c[k];
        uint64_t mask = p->depends[k];
        span v = NOTHING, da = NOTHING, db = NOTHING;
        span x = op > CONSTANT ? p->value[a] : NOTHING, y = op > CONSTANT && b >= 0 ? p->value[b] : NOTHING;
        char fault = 0;
        span *out = p->slope + (size_t)k * n;
        if (op == INPUT) {
            v = a < n ? box[a] : readings[a - n];
            if (!isfinite(v.lo) || !isfinite(v.hi)) bad = 1;
            p->value[k] = bad ? ALL : v, p->fault[k] = bad;
            if (slopes && a < n) out[a] = UNIT;
            continue;
        }
        if (op == CONSTANT) {
            p->value[k] = p->number[k], p->fault[k] = !isfinite(p->number[k].lo) || !isfinite(p->number[k].hi);
            continue;
        }
        fault = p->fault[a] | (b >= 0 ? p->fault[b] : 0);
        switch (op) {
        case ADD: case COVER:
            v = add(x, y), da = db = UNIT;
            if (op == COVER && !(v.lo >= 1)) v.lo = 1;
            break;
        case SUB: v = sub(x, y), da = UNIT, db = neg(UNIT); break;
        case MUL: v = mul(x, y), da = y, db = x; break;
        case DIV:
            bad = holds_zero(y), v = over(x, y);
            if (slopes && p->depends[a]) da = over(UNIT, y);
            if (slopes && p->depends[b]) db = neg(over(v, y));
            break;
        case INV:
            bad = holds_zero(x), v = over(UNIT, x);
            if (slopes) da = neg(square(v));
            break;
        case NEG: v = neg(x), da = neg(UNIT); break;
        case TWICE: v = add(x, x), da.lo = da.hi = 2; break;
        case SQ: v = square(x), da = add(x, x); break;
        case SQRT:
            bad = x.lo < 0;
            if (!bad) {
                v = root(x);
                if (slopes) da = over(UNIT, add(v, v));
            }
            break;
        case FABS: v = magnitude(x), da = signs(x); break;
        case FMIN: case FMAX: { /* what is not decided has slopes between those of both */
            span first = op == FMIN ? less(x, y) : less(y, x), second = op == FMIN ? less(y, x) : less(x, y);
            if (op == FMIN) v.lo = smaller(x.lo, y.lo), v.hi = smaller(x.hi, y.hi);
            else v.lo = larger(x.lo, y.lo), v.hi = larger(x.hi, y.hi);
            if (slopes)
                for (i = 0; i < n; i++)
                    if (mask >> i & 1) {
                        span gx = slope_of(p, a, i), gy = slope_of(p, b, i);
                        out[i] = second.hi == 0 && first.hi ? gx : first.hi == 0 && second.hi ? gy : hull(gx, gy);
                    }
            break;
        }
        case SIGN: v = signs(x); break;
        case FLOOR: v.lo = floor(x.lo), v.hi = floor(x.hi); break;
        case CEIL: v.lo = ceil(x.lo), v.hi = ceil(x.hi); break;
        case LT: v = less(x, y); break;
        case LE: v = less_equal(x, y); break;
        case EQ: v = equal(x, y); break;
        case NE: v = negation(equal(x, y)); break;
        case NOT: v = negation(truth(x)); break;
        case AND: x = truth(x), y = truth(y), v.lo = smaller(x.lo, y.lo), v.hi = smaller(x.hi, y.hi); break;
        case OR: x = truth(x), y = truth(y), v.lo = larger(x.lo, y.lo), v.hi = larger(x.hi, y.hi); break;
        case COPYSIGN: {
            span m = magnitude(x);
            int jump = holds_zero(y);
            v.lo = y.lo > 0 ? m.lo : -m.hi, v.hi = y.hi < 0 ? -m.lo : m.hi;
            da = jump ? ALL : mul(signs(x), signs(y)), db = jump ? ALL : NOTHING;
            break;
        }
        case WHOLE_POWER: {
            int e = (int)p->number[k].lo;
            span factor = {e, e};
            v = whole_power(x, e);
            if (slopes) da = e == 1 ? UNIT : mul(factor, whole_power(x, e - 1));
            break;
        }
        case IF_ELSE_ZERO: case SELECT: {
            span h = truth(x), z = op == SELECT ? p->value[c] : NOTHING;
            fault = p->fault[a] | (h.hi == 0 ? 0 : p->fault[b]);
            if (op == SELECT && h.lo != 1) fault |= p->fault[c];
            v = h.lo == 1 ? y : h.hi == 0 ? z : hull(y, z);
            if (slopes)
                for (i = 0; i < n; i++)
                    if (mask >> i & 1) {
                        span gy = slope_of(p, b, i), gz = op == SELECT ? slope_of(p, c, i) : NOTHING;
                        if (h.lo == 1 || h.hi == 0) out[i] = h.lo == 1 ? gy : gz;
                        else out[i] = p->depends[a] >> i & 1 ? ALL : hull(gy, gz);
                    }
            break;
        }
        case MEET: /* one quantity in two forms: along one coordinate the slopes of both hold */
            fault = p->fault[b], v = p->fault[a] ? y : meet(x, y);
            if (slopes)
                for (i = 0; i < n; i++)
                    if (mask >> i & 1) {
                        span gx = slope_of(p, a, i), gy = slope_of(p, b, i), both = meet(gx, gy);
                        out[i] = p->fault[a] || both.lo > both.hi ? gy : both;
                    }
            break;
        default: { /* ASKED */
            double told[4] = {x.lo, x.hi, y.lo, y.hi}, answer[ANSWERS];
            if (fault) break;
            for (i = 0; i < ANSWERS; i++) answer[i] = NAN;
            p->ask(k, told, answer);
            bad = answer[ANSWERS - 1] != HOLDS;
            v.lo = answer[0], v.hi = answer[1];
            da.lo = answer[2], da.hi = answer[3], db.lo = answer[4], db.hi = answer[5];
        }
        }
        if (op >= SIGN && op <= OR) { /* no slope where the result is decided, any across a jump */
            da = v.lo == v.hi ? NOTHING : ALL, db = da;
        }
        fault |= bad;
        p->fault[k] = fault;
        p->value[k] = fault ? ALL : known(v);
        if (!slopes) continue;
        if (fault) {
            for (i = 0; i < n; i++)
                if (mask >> i & 1) out[i] = ALL;
            continue;
        }
        if (op == FMIN || op == FMAX || op == IF_ELSE_ZERO || op == SELECT || op == MEET) continue;
        da = known(da), db = known(db);
        for (i = 0; i < n && mask >> i; i++) {
            span g = NOTHING;
            if (!(mask >> i & 1)) continue;
            if (p->depends[a] >> i & 1) g = chained(p->slope[(size_t)a * n + i], da);
            if (b >= 0 && p->depends[b] >> i & 1) {
                span h = chained(p->slope[(size_t)b * n + i], db);
                g = p->depends[a] >> i & 1 ? known(add(g, h)) : h;
            }
            out[i] = g;
        }
    }
}

#define MOST 64

static int bounded(span x) { return isfinite(x.lo) && isfinite(x.hi); }

/* Where to cut a box along a coordinate that costs: the kink nearest to the middle that this coordinate alone crosses,
   else the middle. ``held`` was evaluated last, or holds what was. Any place is as right as another. */
static double cut_of(const program *p, goal g, const span *held, int by) {
    double middle = held[by].lo / 2 + held[by].hi / 2, best = middle, nearest = INF;
    int at;
    for (at = 0; at < g.count; at++) {
        int k = g.list[at], op = p->op[k], a = p->a[k], b = p->b[k];
        span d, s;
        double rate, kink;
        if ((op != FMIN && op != FMAX && op != FABS) || p->depends[k] != (uint64_t)1 << by || p->fault[k]) continue;
        d = op == FABS ? p->value[a] : sub(p->value[a], p->value[b]);
        s = op == FABS ? slope_of(p, a, by) : sub(slope_of(p, a, by), slope_of(p, b, by));
        rate = s.lo / 2 + s.hi / 2;
        kink = (rate > 0 ? held[by].lo : held[by].hi) - d.lo / rate;
        if (kink > held[by].lo && kink < held[by].hi && fabs(kink - middle) < nearest)
            nearest = fabs(kink - middle), best = kink;
    }
    return best;
}

/* One end of a goal on a box, kept in ``held``: plain, with monotone coordinates held at their better ends, and by the
   mean value. ``steep`` gets the coordinate that costs most, -1 where none does; ``met`` a value that is taken, rounded
   to the unfavourable side. ``looked`` says that the box was evaluated last, with slopes. */
static double one_end(const program *p, goal g, span *held, const span *readings, int lower, int *steep, double *cut,
                      double *met, int looked) {
    span slope[MOST], mid[MOST], change;
    int n = p->coordinates, i, round, moved = 1, sloped = 1;
    uint64_t on = p->depends[g.node];
    double best = lower ? -INF : INF, worst = 0;
    *steep = -1, *met = lower ? INF : -INF;
    for (round = 0; round < 3 && moved && sloped; round++) {
        if (round || !looked) evaluate(p, g.list, g.count, held, readings, 1);
        if (p->fault[g.node]) sloped = 0;
        else best = lower ? larger(best, p->value[g.node].lo) : smaller(best, p->value[g.node].hi);
        moved = 0;
        for (i = 0; i < n; i++) {
            slope[i] = on >> i & 1 ? p->slope[(size_t)g.node * n + i] : NOTHING;
            if (!bounded(slope[i])) sloped = 0;
        }
        for (i = 0; sloped && i < n; i++) {
            if (held[i].lo == held[i].hi || !(on >> i & 1) || (slope[i].lo < 0 && slope[i].hi > 0)) continue;
            if ((slope[i].lo >= 0) == lower) held[i].hi = held[i].lo;
            else held[i].lo = held[i].hi;
            moved = 1;
        }
    }
    for (i = 0; i < n; i++) {
        double width = held[i].hi - held[i].lo, cost;
        mid[i] = held[i];
        if (!(width > 0) || !(on >> i & 1)) continue;
        cost = sloped ? larger(fabs(slope[i].lo), fabs(slope[i].hi)) * width : width;
        if (cost > worst) worst = cost, *steep = i;
        mid[i].lo = mid[i].hi = smaller(held[i].hi, larger(held[i].lo, held[i].lo / 2 + held[i].hi / 2));
    }
    if (*steep >= 0) *cut = cut_of(p, g, held, *steep);
    if (sloped && !moved && *steep < 0 && !p->fault[g.node]) { /* what was looked at last is one point, or no wider */
        *met = lower ? p->value[g.node].hi : p->value[g.node].lo;
        return best;
    }
    evaluate(p, g.list, g.count, mid, readings, 0);
    if (p->fault[g.node]) return best;
    change = p->value[g.node];
    *met = lower ? change.hi : change.lo;
    if (!sloped) return best;
    for (i = 0; i < n; i++)
        if (mid[i].lo != held[i].lo || mid[i].hi != held[i].hi) change = add(change, mul(slope[i], sub(held[i], mid[i])));
    change = known(change);
    return lower ? larger(best, change.lo) : smaller(best, change.hi);
}

#define PARTS 96
#define NEAR 0x1p-10 /* of what the first look left open, to which an end is sought */

/* The same by splitting the boxes that are worst until little is left open, or ``parts`` boxes are looked at. */
static double end_of(const program *p, goal g, const span *box, const span *readings, int lower, int parts,
                     int looked) {
    static _Thread_local span kept[PARTS][MOST];
    double bound[PARTS], cut[PARTS], first, met, sign = lower ? 1 : -1, best, aim;
    int n = p->coordinates, steep[PARTS], count = 1, i, worst;
    size_t size = n * sizeof(span);
    memcpy(kept[0], box, size);
    bound[0] = first = sign * one_end(p, g, kept[0], readings, lower, &steep[0], &cut[0], &met, looked);
    best = sign * met;
    aim = NEAR * (best - first);
    if (!isfinite(aim)) aim = 0; /* where nothing is known yet */
    while (count + 1 < parts && count + 1 < PARTS) {
        int made;
        for (i = 1, worst = 0; i < count; i++)
            if (bound[i] < bound[worst]) worst = i;
        if (!(bound[worst] < best - aim) || steep[worst] < 0) break;
        i = steep[worst];
        memcpy(kept[count], kept[worst], size);
        met = cut[worst];
        if (!(met > kept[worst][i].lo && met < kept[worst][i].hi)) break;
        kept[worst][i].hi = kept[count][i].lo = met;
        first = bound[worst];
        for (made = worst, i = 0; i < 2; i++, made = count) {
            double found = sign * one_end(p, g, kept[made], readings, lower, &steep[made], &cut[made], &met, 0);
            bound[made] = larger(first, found);
            best = smaller(best, sign * met);
        }
        count++;
    }
    for (i = 1, first = bound[0]; i < count; i++) first = smaller(first, bound[i]);
    return sign * first;
}

static span both_ends(const program *p, goal g, const span *box, const span *readings, int parts) {
    span r;
    evaluate(p, g.list, g.count, box, readings, 1);
    if (p->value[g.node].lo == p->value[g.node].hi && !p->fault[g.node]) return p->value[g.node];
    r.lo = end_of(p, g, box, readings, 1, parts, 1);
    r.hi = end_of(p, g, box, readings, 0, parts, 0);
    return r;
}

/* Set the last coordinates of a box to the ranges of what they stand for. */
static void fill(const program *p, span *box, const span *readings) {
    int i;
    for (i = 0; i < p->inner; i++)
        box[p->coordinates - p->inner + i] = both_ends(p, p->within[i], box, readings, PARTS);
}

/* The slope of a goal by one coordinate on a box. */
static span slope_by(const program *p, goal g, const span *box, const span *readings, int by) {
    evaluate(p, g.list, g.count, box, readings, 1);
    if (p->fault[g.node]) return ALL;
    return p->depends[g.node] >> by & 1 ? known(p->slope[(size_t)g.node * p->coordinates + by]) : NOTHING;
}

enum { FINE, UNDEFINED, UNREACHED, NOT_RISING, GAIN, UNBOUNDED };

/* What becomes of the inputs: they are what every trial may meet, they are given and move on, or trials have ended up
   where learning leads them. */
enum { LEARNING, GIVEN, SETTLED };

/* A plant's numbers and the sets of a pass; rows are signals, columns samples. */
typedef struct {
    int samples, states, input, mode, parts;
    const goal *next;            /* of every state */
    goal gained, output;         /* the learned signal's gain in a sample; the output */
    double most_gain;            /* l_max */
    const span *readings;        /* (samples + 1, readings) */
    const span *fixed;           /* (samples + 1, coordinates): ranges of all but state and input */
    const span *wanted;          /* (samples): wanted gains of the learned signal */
    const span *plan;            /* (samples): first plan, or inputs that are given */
    const span *moves;           /* (samples): the gains by which inputs that are given move to their target */
    const double *jolt;          /* (states): what a sample may add to a state besides */
    const span *start;           /* (states) */
    span *x, *y, *u, *target, *slope, *after;
    int *failed_at;
} pass;

static double middle(span x) { return x.lo / 2 + x.hi / 2; }

/* Inputs at which a goal takes a wanted value, if at one input it lies in f and its slopes from there on in b. */
static span reached(double from, span f, span b, span wanted) {
    double up = sum_up(wanted.hi, -f.lo), down = sum_down(wanted.lo, -f.hi);
    span found = {sum_down(from, quotient_down(down, down < 0 ? b.lo : b.hi)),
                  sum_up(from, quotient_up(up, up > 0 ? b.lo : b.hi))};
    return found;
}

/* Inputs with which a goal, rising in the input, takes a wanted value from every point of a box. */
static int solve(const program *p, const pass *q, span *box, const span *readings, span wanted, double from,
                 span *target, span *slope) {
    int in = q->input, tries;
    span region = {from, from}, f, b, found = region;
    box[in] = region;
    f = both_ends(p, q->gained, box, readings, q->parts);
    if (!bounded(f)) return UNDEFINED;
    b = slope_by(p, q->gained, box, readings, in);
    for (tries = 0; tries < 60; tries++) {
        double room;
        if (!bounded(b)) return UNDEFINED;
        if (!(b.lo > 0)) return tries ? UNREACHED : NOT_RISING;
        found = reached(from, f, b, wanted);
        if (!bounded(found)) return UNBOUNDED;
        if (tries && found.lo >= region.lo && found.hi <= region.hi) break;
        region.lo = smaller(smaller(region.lo, found.lo), from), region.hi = larger(larger(region.hi, found.hi), from);
        room = (tries ? 0.1 : 1e-9) * (region.hi - region.lo) + 1e-300;
        region.lo -= room, region.hi += room;
        box[in] = region;
        b = slope_by(p, q->gained, box, readings, in);
    }
    if (tries == 60) return UNREACHED;
    if (b.lo < b.hi) /* nearer: the targets lie between the ends found, and so do the slopes that matter */
        for (tries = 0; tries < 12; tries++) {
            double at = smaller(found.hi, larger(found.lo, middle(found))), width = found.hi - found.lo, left;
            span steep, nearer;
            box[in] = found;
            steep = slope_by(p, q->gained, box, readings, in);
            if (!(steep.lo > 0)) break;
            box[in].lo = box[in].hi = at;
            nearer = meet(found, reached(at, both_ends(p, q->gained, box, readings, q->parts), steep, wanted));
            if (nearer.lo <= nearer.hi) found = nearer;
            box[in].lo = box[in].hi = found.hi; /* by what is too much at the upper end, and left at the lower */
            left = sum_down(end_of(p, q->gained, box, readings, 1, q->parts, 0), -wanted.hi);
            if (left > 0) found.hi = larger(sum_up(found.hi, -quotient_down(left, steep.hi)), found.lo);
            box[in].lo = box[in].hi = found.lo;
            left = sum_down(wanted.lo, -end_of(p, q->gained, box, readings, 0, q->parts, 0));
            if (left > 0) found.lo = smaller(sum_down(found.lo, quotient_down(left, steep.hi)), found.hi);
            if (!(found.hi - found.lo < 0.99 * width)) break;
        }
    *target = found, *slope = b;
    return FINE;
}

/* Carry the set of states through all samples; return why it ended, FINE where it did not. */
int carry(const program *p, const pass *q) {
    int k, i, n = p->coordinates, nx = q->states, in = q->input, code;
    span box[MOST], moved[MOST];
    for (i = 0; i < nx; i++) q->x[i] = q->start[i];
    for (k = 0; k <= q->samples; k++) {
        const span *readings = q->readings + (size_t)k * p->readings;
        span u, t, b, region;
        double reach;
        int tries;
        *q->failed_at = k;
        memcpy(box, q->fixed + (size_t)k * n, n * sizeof(span));
        memcpy(box, q->x + (size_t)k * nx, nx * sizeof(span));
        box[in] = q->plan[k < q->samples ? k : q->samples - 1];
        for (i = 0; i < nx; i++)
            if (!bounded(box[i])) return UNBOUNDED;
        fill(p, box, readings);
        q->y[k] = both_ends(p, q->output, box, readings, q->parts);
        if (!bounded(q->y[k])) return UNDEFINED;
        if (k == q->samples) break;
        code = solve(p, q, box, readings, q->wanted[k], middle(q->plan[k]), &t, &b);
        if (code != FINE) return code;
        t.lo = below(t.lo), t.hi = above(t.hi);
        q->target[k] = t;
        u = q->mode == GIVEN ? q->plan[k] : q->mode == SETTLED ? t : hull(q->plan[k], t);
        for (tries = 0;; tries++) {
            region = box[in] = hull(u, t);
            q->slope[k] = b = slope_by(p, q->gained, box, readings, in);
            if (!bounded(b)) return UNDEFINED;
            if (!(b.lo > 0)) return NOT_RISING;
            reach = product_up(q->most_gain, b.hi);
            if (reach <= 1 || q->mode == GIVEN) break;
            if (reach >= 2 || tries == 20) return GAIN;
            { /* beyond 1 an input may overshoot its target, by less than it was off */
                double m = middle(t), w = larger(sum_up(t.hi, -m), sum_up(m, -t.lo)), far, share;
                share = product_up(w, quotient_up(reach, sum_down(2, -reach)));
                far = larger(share, w);
                if (q->mode == LEARNING)
                    far = larger(far, larger(sum_up(q->plan[k].hi, -m), sum_up(m, -q->plan[k].lo)));
                u.lo = sum_down(m, -far), u.hi = sum_up(m, far);
                if (u.lo >= region.lo && u.hi <= region.hi) break;
                u = hull(u, region);
            }
        }
        q->u[k] = u;
        if (q->mode == GIVEN) {
            span share = q->moves[k], rest, at[2], to;
            share = mul(share, b);
            if (!(share.hi < 2)) return GAIN;
            at[0].lo = at[0].hi = share.lo, at[1].lo = at[1].hi = share.hi;
            for (i = 0; i < 2; i++) {
                rest = sub(UNIT, at[i]);
                to = add(mul(rest, u), mul(at[i], t));
                q->after[k] = i ? hull(q->after[k], to) : to;
            }
            if (share.lo >= 0 && share.hi <= 1) q->after[k] = meet(q->after[k], hull(u, t));
        }
        box[in] = u;
        for (i = 0; i < nx; i++) {
            moved[i] = both_ends(p, q->next[i], box, readings, q->parts);
            if (!bounded(moved[i])) return UNDEFINED;
            if (q->jolt[i] > 0) moved[i].lo = sum_down(moved[i].lo, -q->jolt[i]), moved[i].hi = sum_up(moved[i].hi, q->jolt[i]);
        }
        memcpy(q->x + (size_t)(k + 1) * nx, moved, nx * sizeof(span));
    }
    *q->failed_at = -1;
    return FINE;
}

/* Enclose a goal on many boxes, (boxes, coordinates) with (boxes, readings), in at most ``parts`` parts each. */
void enclose(const program *p, const goal *g, int boxes, span *box, const span *readings, int parts, span *out,
             span *slopes) {
    int i, j, n = p->coordinates;
    for (j = 0; j < boxes; j++, box += n, readings += p->readings, slopes += n) {
        fill(p, box, readings);
        out[j] = both_ends(p, *g, box, readings, parts);
        evaluate(p, g->list, g->count, box, readings, 1);
        for (i = 0; i < n; i++)
            slopes[i] = p->depends[g->node] >> i & 1 ? p->slope[(size_t)g->node * n + i] : NOTHING;
    }
}
