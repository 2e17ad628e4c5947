(* The width of the bounds of examples/degue_4_2.toml falls at every jump, for every dwell time in
   [0, 5]: the inequality of claim dwell_stability, checked by the kernel of Coq.

   Run by hand, on Debian 12:   apt install coq libcoq-interval;  coqc degue_4_2.v

   W = D0 + D1 = [[-3, 1], [0, 0]],  N = Gp + Gn = [[0, 0], [0, 0.8]], the binary64 number next to
   0.8, and P are those of the design file, exact. Proved:  for all t in [0, 5] and x <> 0,
   with M = e^(W t) N,   (M x)' P (M x) < x' P x. *)

From Coq Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
From Interval Require Import Tactic.
Open Scope R_scope.

(* 1. e^(W t), by its differential equation: E' = W E, E(0) = I, which has one solution. *)

Definition e11 (t : R) := exp (-3 * t).
Definition e12 (t : R) := (1 - exp (-3 * t)) / 3.
Definition e21 (t : R) := 0.
Definition e22 (t : R) := 1.

Lemma start : e11 0 = 1 /\ e12 0 = 0 /\ e21 0 = 0 /\ e22 0 = 1.
Proof.
  unfold e11, e12, e21, e22. replace (-3 * 0) with 0 by ring. rewrite exp_0.
  repeat split; field.
Qed.

Lemma flow11 : forall t, is_derive e11 t (-3 * e11 t + 1 * e21 t).
Proof. intro t. unfold e11, e21. auto_derive. exact I. ring. Qed.

Lemma flow12 : forall t, is_derive e12 t (-3 * e12 t + 1 * e22 t).
Proof. intro t. unfold e12, e22. auto_derive. exact I. field. Qed.

Lemma flow21 : forall t, is_derive e21 t (0 * e11 t + 0 * e21 t).
Proof. intro t. unfold e21, e11. auto_derive. exact I. ring. Qed.

Lemma flow22 : forall t, is_derive e22 t (0 * e12 t + 0 * e22 t).
Proof. intro t. unfold e22, e12. auto_derive. exact I. ring. Qed.

(* 2. The numbers of the design file. *)

Definition n22 := 3602879701896397 / 4503599627370496.
Definition p11 := 4531569297446763 / 9007199254740992.
Definition p12 := 2448047477849283 / 4722366482869645213696.
Definition p22 := 3370707303008805 / 2251799813685248.

(* V(x) = x' P x, and M = e^(W t) N, whose first column is zero. *)

Definition V (x y : R) := p11 * x * x + 2 * p12 * x * y + p22 * y * y.
Definition m1 (t : R) := e12 t * n22.
Definition m2 (t : R) := e22 t * n22.

(* 3. A quadratic form with a > 0 and a c - b^2 > 0 is positive. *)

Lemma positive_form : forall a b c x y, 0 < a -> 0 < a * c - b * b -> x <> 0 \/ y <> 0 ->
  0 < a * x * x + 2 * b * x * y + c * y * y.
Proof.
  intros a b c x y Ha Hd Hxy.
  assert (square : a * (a * x * x + 2 * b * x * y + c * y * y)
                   = (a * x + b * y) * (a * x + b * y) + (a * c - b * b) * (y * y)) by ring.
  apply Rmult_lt_reg_l with a; [exact Ha |]. rewrite Rmult_0_r, square.
  destruct (Req_dec y 0) as [Hy | Hy].
  - destruct Hxy as [Hx | Hx]; [| contradiction]. subst y.
    assert (0 < (a * x) * (a * x)).
    { apply Rsqr_pos_lt. apply Rmult_integral_contrapositive. split; [lra | exact Hx]. }
    lra.
  - assert (0 < y * y) by (apply Rsqr_pos_lt; exact Hy).
    assert (0 < (a * c - b * b) * (y * y)) by (apply Rmult_lt_0_compat; assumption).
    assert (0 <= (a * x + b * y) * (a * x + b * y)) by apply Rle_0_sqr. lra.
Qed.

(* 4. P - M' P M, whose only entry that depends on t is the last one. *)

Lemma first_minor : 0 < p11.
Proof. unfold p11. interval. Qed.

Lemma second_minor : forall t, 0 <= t <= 5 ->
  0 < p11 * (p22 - V (m1 t) (m2 t)) - p12 * p12.
Proof.
  intros t Ht. unfold V, m1, m2, e12, e22, n22, p11, p12, p22.
  interval with (i_bisect t, i_prec 60).
Qed.

Theorem width_falls_at_every_jump : forall t x y, 0 <= t <= 5 -> x <> 0 \/ y <> 0 ->
  V (m1 t * y) (m2 t * y) < V x y.
Proof.
  intros t x y Ht Hxy.
  assert (positive := positive_form p11 p12 (p22 - V (m1 t) (m2 t)) x y
                        first_minor (second_minor t Ht) Hxy).
  assert (V x y - V (m1 t * y) (m2 t * y)
          = p11 * x * x + 2 * p12 * x * y + (p22 - V (m1 t) (m2 t)) * y * y) by (unfold V; ring).
  lra.
Qed.

Print Assumptions width_falls_at_every_jump.
