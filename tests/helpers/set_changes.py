"""Changes of the printed C of sets that a comparison with the reference must notice: (text, what instead)."""

CHANGES = [("key[k] > key[best]", "key[k] >= key[best]"),
           ("for (uint32_t j = PT_KEPT;", "for (uint32_t j = PT_KEPT + 1U;"),
           ("box[i] = rounding[i]", "box[i] = 0.0F"), ("matrix[i][j] * box[j]", "matrix[j][i] * box[j]"),
           ("s->origin = p;", "s->origin = PT_MODES;"), ("raw |= PT_BIT_TOGETHER", "raw |= 0U"),
           ("radius[i] = spread[o][i]", "radius[i] = 0.0F"), ("noise[q][o]", "noise[q][0U]"),
           ("rho[q][i]", "rho[0][0]")]


TABLE_CHANGES = [("< 3U)", "< 4U)"), ("s->stage++;", "s->stage = 1U;"), ("(PT_ANEW - 1U)", "(PT_ANEW - 2U)"),
                 ("s->since++;", "s->since = 0U;"), ("inside = false", "inside = true"),
                 ("direction[i - PT_NY][j]", "direction[0][j]"),
                 ("return (s->since < PT_ROWS) ? s->since", "return (s->since < 1U) ? 0U")]


PAIR_CHANGES = [("term[a + 2U] * term[b + 0U]", "term[a + 1U] * term[b + 0U]"), ("j = i + 1U;", "j = i + 9U;"),
                ("(term[a + 0U] * term[b + 1U]) -", "(term[a + 0U] * term[b + 1U]) +"),
                ("i < PT_EDGES", "i < 2U")]
SCHEDULE_CHANGES = [("cycle[at] != in->mode", "cycle[0] != in->mode"), ("s->since = PT_SETTLED;", "s->since++;"),
                    ("s->phase_at = entry[in->mode]", "s->phase_at = entry[0]"), ("s->phase_at++;", ";"),
                    ("* PT_MODES) + in->mode", "* PT_MODES) + 0U"), ("s->since++;", ";"),
                    ("(PT_BEGIN * PT_MODES) + s->phase_at", "(PT_BEGIN * PT_MODES)")]
BLOCK_CHANGES = [("box[i] = rounding[i]", "box[i] = 0.0F"),
                 ("s->since >= PT_LONGEST", "s->since > PT_LONGEST"), ("(p != s->block) ||", "(p > 9U) ||"),
                 ("s->before = s->origin;", ";"), ("s->block = p;", "s->block = 0U;"),
                 ("power[b][at][i][k]", "power[b][at][k][i]"), ("noise[now]", "noise[0]"),
                 ("added[o][b][at][first", "added[0][b][at][first"),
                 ("(radius[i] <= wide[i])", "(radius[i] <= 0.1F)"), ("(sum <= most[i])", "(sum <= 0.1F)")]
BOX_CHANGES = [("next[i] = added[p][o][i]", "next[i] = added[p][0U][i]"), ("size[p][i][k]", "size[p][k][i]"),
               ("s->origin = p;", "s->origin = PT_MODES;"), ("noise[q][o][i]", "noise[q][0U][i]"),
               ("radius[i] = spread[o][i] + ", "radius[i] = "),
               ("<= out->r_bound[i])", "<= (2.0F * out->r_bound[i]))")]
TURN_CHANGES = [("size[i][k]", "size[k][i]"), ("size[q][i][k]", "size[q][0][k]"), ("s->shape[i] = half[i]",
                                                                                  "s->shape[i] = half[0]")]
TRACE_CHANGES = [("carried = 1.0F + (1.0F / share)", "carried = 1.0F"), ("added = 1.0F + share", "added = 1.0F"),
                 ("(rounding[p][i] * trace)", "0.0F"), ("(rounding[q][i] * trace)", "0.0F"),
                 ("k < PT_HERON", "k < (PT_HERON - 1U)"), ("inverse[p][o]", "inverse[p][0U]"),
                 ("noise[q][o]", "noise[q][0U]"), ("s->origin = p;", "s->origin = PT_MODES;"),
                 ("(other < root) ? other", "(other > root) ? other"), ("raw |= PT_BIT_TOGETHER", "raw |= 0U"),
                 ("root(weight[i] * square)", "root(square)"), ("= (value < ", "= (value > ")]
#: Of a zonotope boxed in other coordinates, its columns compared by Girard's key.
BASIS_CHANGES = [("basis[i][k] * shape", "basis[k][i] * shape"), ("back[i][j] * box[j]", "matrix[i][j] * box[j]"),
                 ("key[j] -= most;", ""), ("box[i] = rounding[i]", "box[i] = 0.0F"), ("entry > most", "entry < most")]
