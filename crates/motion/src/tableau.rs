//! Coefficients of the explicit Runge–Kutta methods.
//!
//! - DOP853: Dormand and Prince's eighth-order pair with Hairer's error estimates (fifth and third order) and seventh-order
//!   dense output; Hairer, Nørsett, Wanner, *Solving Ordinary Differential Equations I*, II.5–II.6 and `dop853.f`.
//! - Tsit5: Tsitouras, *Comput. Math. Appl.* 62, 770 (2011), fifth-order pair with fourth-order dense output.
//! - RK4: the classical method, with a cubic Hermite interpolant.
#![allow(clippy::excessive_precision, clippy::unreadable_literal)]

/// How the local error of a step is measured.
#[derive(Clone, Copy, Debug)]
pub enum ErrorWeights {
    /// None: a fixed step.
    None,
    /// One embedded formula: weights of the stages, the end point last.
    Single(&'static [f64]),
    /// Hairer's combination of a fifth- and a third-order formula.
    Hairer {
        /// Fifth order.
        fifth: &'static [f64],
        /// Third order.
        third: &'static [f64],
    },
}

/// How a step is interpolated.
#[derive(Clone, Copy, Debug)]
pub enum Dense {
    /// Cubic through both ends.
    Hermite,
    /// Tsitouras' fourth-order weights.
    Tsit5,
    /// Hairer's seventh-order polynomial with three more stages.
    Dop853,
}

/// An explicit method. Row i of `a` has the weights of stage i + 2; row `stages − 1` is the end point (first same as last).
#[derive(Clone, Copy, Debug)]
pub struct Tableau {
    /// Stages up to the end point, which is one more evaluation and the next step's first.
    pub stages: usize,
    /// Order of the method.
    pub order: u32,
    /// Weights.
    pub a: &'static [&'static [f64]],
    /// Nodes, one per stage.
    pub c: &'static [f64],
    /// Error estimate.
    pub error: ErrorWeights,
    /// Interpolation.
    pub dense: Dense,
    /// Exponents (of the present and the last error) of the step size controller.
    pub controller: (f64, f64),
}

/// Classical Runge–Kutta.
pub const RK4: Tableau = Tableau {
    stages: 4,
    order: 4,
    a: &[&[0.5], &[0.0, 0.5], &[0.0, 0.0, 1.0], &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]],
    c: &[0.0, 0.5, 0.5, 1.0, 1.0],
    error: ErrorWeights::None,
    dense: Dense::Hermite,
    controller: (0.0, 0.0),
};

/// Tsitouras 5(4).
pub const TSIT5: Tableau = Tableau {
    stages: 6,
    order: 5,
    a: &[
        &[0.161],
        &[-0.008480655492356989, 0.335480655492357],
        &[2.8971530571054935, -6.359448489975075, 4.3622954328695815],
        &[5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525],
        &[5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383],
        &[
            0.09646076681806523,
            0.01,
            0.4798896504144996,
            1.379008574103742,
            -3.290069515436081,
            2.324710524099774,
        ],
    ],
    c: &[0.0, 0.161, 0.327, 0.9, 0.9800255409045097, 1.0, 1.0],
    error: ErrorWeights::Single(&[
        -0.00178001105222577714,
        -0.0008164344596567469,
        0.007880878010261995,
        -0.1447110071732629,
        0.5823571654525552,
        -0.45808210592918697,
        1.0 / 66.0,
    ]),
    dense: Dense::Tsit5,
    controller: (0.7 / 5.0, 0.4 / 5.0),
};

/// Dormand–Prince 8(5,3).
pub const DOP853: Tableau = Tableau {
    stages: 12,
    order: 8,
    a: DOP853_A,
    c: DOP853_C,
    error: ErrorWeights::Hairer { fifth: DOP853_E5, third: DOP853_E3 },
    dense: Dense::Dop853,
    controller: (1.0 / 8.0, 0.0),
};

/// Tsitouras' interpolation weights at θ in [0, 1], end point included.
pub fn tsit5_weights(theta: f64) -> [f64; 7] {
    let t = theta;
    let t2 = t * t;
    [
        -1.0530884977290216
            * t
            * (t - 1.3299890189751412)
            * (t2 - 1.4364028541716351 * t + 0.7139816917074209),
        0.1017 * t2 * (t2 - 2.1966568338249754 * t + 1.2949852507374631),
        2.490627285651252793 * t2 * (t2 - 2.38535645472061657 * t + 1.57803468208092486),
        -16.54810288924490272 * (t - 1.21712927295533244) * (t - 0.61620406037800089) * t2,
        47.37952196281928122 * (t - 1.203071208372362603) * (t - 0.658047292653547382) * t2,
        -34.87065786149660974 * (t - 1.2) * (t - 0.666666666666666667) * t2,
        2.5 * (t - 1.0) * (t - 0.6) * t2,
    ]
}

/// Weights of the stages in the four highest coefficients of DOP853's dense output.
pub const DOP853_DENSE: &[&[f64]] = DOP853_D;

/// Stages 2–12, then the end point (13), then the three of the dense output.
const DOP853_A: &[&[f64]] = &[
    &[0.05260015195876773],
    &[0.0197250569845379, 0.0591751709536137],
    &[0.02958758547680685, 0.0, 0.08876275643042054],
    &[0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
    &[0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
    &[0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
    &[
        0.03709200011850479,
        0.0,
        0.0,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
    ],
    &[
        0.6241109587160757,
        0.0,
        0.0,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
    ],
    &[
        0.47766253643826434,
        0.0,
        0.0,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
    ],
    &[
        -0.9371424300859873,
        0.0,
        0.0,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
    ],
    &[
        2.273310147516538,
        0.0,
        0.0,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ],
    &[
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ],
    &[
        0.056167502283047954,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.25350021021662483,
        -0.2462390374708025,
        -0.12419142326381637,
        0.15329179827876568,
        0.00820105229563469,
        0.007567897660545699,
        -0.008298,
    ],
    &[
        0.03183464816350214,
        0.0,
        0.0,
        0.0,
        0.0,
        0.028300909672366776,
        0.053541988307438566,
        -0.05492374857139099,
        0.0,
        0.0,
        -0.00010834732869724932,
        0.0003825710908356584,
        -0.00034046500868740456,
        0.1413124436746325,
    ],
    &[
        -0.42889630158379194,
        0.0,
        0.0,
        0.0,
        0.0,
        -4.697621415361164,
        7.683421196062599,
        4.06898981839711,
        0.3567271874552811,
        0.0,
        0.0,
        0.0,
        -0.0013990241651590145,
        2.9475147891527724,
        -9.15095847217987,
    ],
];
const DOP853_C: &[f64] = &[
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
    1.0,
    0.1,
    0.2,
    0.7777777777777778,
];
const DOP853_E5: &[f64] = &[
    0.01312004499419488,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
];
const DOP853_E3: &[f64] = &[
    -0.18980075407240762,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    -0.4226823213237919,
    -0.1521609496625161,
    0.20136540080403034,
    0.02265179219836082,
];
const DOP853_D: &[&[f64]] = &[
    &[
        -8.428938276109013,
        0.0,
        0.0,
        0.0,
        0.0,
        0.5667149535193777,
        -3.0689499459498917,
        2.38466765651207,
        2.117034582445028,
        -0.871391583777973,
        2.2404374302607883,
        0.6315787787694688,
        -0.08899033645133331,
        18.148505520854727,
        -9.194632392478356,
        -4.436036387594894,
    ],
    &[
        10.427508642579134,
        0.0,
        0.0,
        0.0,
        0.0,
        242.28349177525817,
        165.20045171727028,
        -374.5467547226902,
        -22.113666853125306,
        7.733432668472264,
        -30.674084731089398,
        -9.332130526430229,
        15.697238121770845,
        -31.139403219565178,
        -9.35292435884448,
        35.81684148639408,
    ],
    &[
        19.985053242002433,
        0.0,
        0.0,
        0.0,
        0.0,
        -387.0373087493518,
        -189.17813819516758,
        527.8081592054236,
        -11.57390253995963,
        6.8812326946963,
        -1.0006050966910838,
        0.7777137798053443,
        -2.778205752353508,
        -60.19669523126412,
        84.32040550667716,
        11.99229113618279,
    ],
    &[
        -25.69393346270375,
        0.0,
        0.0,
        0.0,
        0.0,
        -154.18974869023643,
        -231.5293791760455,
        357.6391179106141,
        93.40532418362432,
        -37.45832313645163,
        104.0996495089623,
        29.8402934266605,
        -43.53345659001114,
        96.32455395918828,
        -39.17726167561544,
        -149.72683625798564,
    ],
];

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(t: &Tableau) -> &'static [f64] {
        t.a[t.stages - 1]
    }

    /// Row sums are the nodes; b·cᵏ = 1/(k+1) up to the order; b·A·cᵏ = 1/((k+1)(k+2)).
    #[test]
    fn order_conditions_hold_to_rounding() {
        for t in [RK4, TSIT5, DOP853] {
            for (i, row) in t.a.iter().enumerate() {
                let sum: f64 = row.iter().sum();
                // DOP853's weights reach 30, so a sum of 15 of them is good to some hundred ε.
                assert!((sum - t.c[i + 1]).abs() < 500.0 * f64::EPSILON, "row {i} of order {}", t.order);
            }
            let b = weights(&t);
            for k in 0..t.order as i32 {
                let sum: f64 = b.iter().zip(t.c).map(|(b, c)| b * c.powi(k)).sum();
                assert!(
                    (sum - 1.0 / (k as f64 + 1.0)).abs() < 500.0 * f64::EPSILON,
                    "b c^{k}, order {}",
                    t.order
                );
            }
            for k in 0..t.order as i32 - 1 {
                let stage = |i: usize| match i {
                    0 => 0.0,
                    i => t.a[i - 1].iter().zip(t.c).map(|(a, c)| a * c.powi(k)).sum::<f64>(),
                };
                let sum: f64 = b.iter().enumerate().map(|(i, b)| b * stage(i)).sum();
                let want = 1.0 / ((k as f64 + 1.0) * (k as f64 + 2.0));
                assert!(
                    (sum - want).abs() < 5000.0 * f64::EPSILON,
                    "b A c^{k}, order {}: {:e}",
                    t.order,
                    sum - want
                );
            }
        }
    }

    #[test]
    fn error_weights_vanish_on_constants() {
        let sum = |w: &[f64]| w.iter().sum::<f64>().abs();
        let ErrorWeights::Single(w) = TSIT5.error else { unreachable!("Tsit5 has one") };
        let ErrorWeights::Hairer { fifth, third } = DOP853.error else { unreachable!("DOP853 has two") };
        assert!(sum(w) < 20.0 * f64::EPSILON);
        assert!(sum(fifth) < 100.0 * f64::EPSILON && sum(third) < 100.0 * f64::EPSILON);
    }

    #[test]
    fn tsit5_interpolates_to_fourth_order() {
        assert!(tsit5_weights(0.0).iter().all(|w| *w == 0.0));
        for theta in [0.1, 0.37, 0.8, 1.0] {
            for k in 0..4 {
                let sum: f64 = tsit5_weights(theta).iter().zip(TSIT5.c).map(|(b, c)| b * c.powi(k)).sum();
                let want = theta.powi(k + 1) / (k as f64 + 1.0);
                // Printed coefficients have 15 to 18 digits and reach 47.
                assert!((sum - want).abs() < 1000.0 * f64::EPSILON, "θ = {theta}, k = {k}: {:e}", sum - want);
            }
        }
    }
}
