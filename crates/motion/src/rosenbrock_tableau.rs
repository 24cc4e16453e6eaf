//! Coefficients of the Rosenbrock methods, in the form that needs no products with the Jacobian.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | γ, a, C, c, d | stages W u_i = f(y + Σ a_ij u_j) + (1/h) Σ C_ij u_j + h d_i ∂f/∂t, W = I/(hγ) − J | Hairer, Wanner, *Solving ODEs II*, IV.7 (7.25) |
//! | H | dense output: y(θ) = (1−θ) y₀ + θ (y₁ + (1−θ)(K₁ + θ (K₂ + θ K₃))), K = H u | `rodas.f`; Steinebach 2023 |
//!
//! - Rodas4: Hairer and Wanner, *Solving Ordinary Differential Equations II*, IV.10, `rodas.f`.
//! - Rodas5P: Steinebach, *BIT Numer. Math.* 63, 27 (2023).
//!
//! Both are stiffly accurate and L-stable; the last stage is the end point less the embedded one.
#![allow(clippy::excessive_precision, clippy::unreadable_literal)]

/// A Rosenbrock method. Rows have the weights of the stages before.
#[derive(Clone, Copy, Debug)]
pub struct RosenbrockTableau {
    /// Order of the method; that of the embedded one is one less.
    pub order: u32,
    /// γ.
    pub gamma: f64,
    /// a, without the first row. The last rows add the stage before with weight 1.
    pub a: &'static [&'static [f64]],
    /// C, without the first row.
    pub c_matrix: &'static [&'static [f64]],
    /// Nodes, one per stage.
    pub c: &'static [f64],
    /// Weights of ∂f/∂t, one per stage.
    pub d: &'static [f64],
    /// Dense output.
    pub h: &'static [&'static [f64]],
}

/// Hairer and Wanner's Rodas: six stages.
pub const RODAS4: RosenbrockTableau = RosenbrockTableau {
    order: 4,
    gamma: 0.25,
    a: &[
        &[1.544],
        &[0.9466785280815826, 0.2557011698983284],
        &[3.314825187068521, 2.896124015972201, 0.9986419139977817],
        &[1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950],
        &[1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ],
    c_matrix: &[
        &[-5.6688],
        &[-2.430093356833875, -0.2063599157091915],
        &[-0.1073529058151375, -9.594562251023355, -20.47028614809616],
        &[7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160],
        &[8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
    ],
    c: &[0.0, 0.386, 0.21, 0.63, 1.0, 1.0],
    d: &[0.25, -0.1043, 0.1035, -0.03620000000000023, 0.0, 0.0],
    h: &[
        &[
            10.12623508344586,
            -7.487995877610167,
            -34.80091861555747,
            -7.992771707568823,
            1.025137723295662,
            0.0,
        ],
        &[
            -0.6762803392806898,
            6.087714651680015,
            16.43084320892478,
            24.76722511418386,
            -6.594389125716872,
            0.0,
        ],
    ],
};

const RODAS5P_END: [f64; 5] =
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946];

/// Steinebach's Rodas5P: eight stages.
pub const RODAS5P: RosenbrockTableau = RosenbrockTableau {
    order: 5,
    gamma: 0.21193756319429014,
    a: &[
        &[3.0],
        &[2.849394379747939, 0.45842242204463923],
        &[-6.954028509809101, 2.489845061869568, -10.358996098473584],
        &[2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641],
        &RODAS5P_END,
        &[RODAS5P_END[0], RODAS5P_END[1], RODAS5P_END[2], RODAS5P_END[3], RODAS5P_END[4], 1.0],
        &[RODAS5P_END[0], RODAS5P_END[1], RODAS5P_END[2], RODAS5P_END[3], RODAS5P_END[4], 1.0, 1.0],
    ],
    c_matrix: &[
        &[-14.155112264123755],
        &[-17.97296035885952, -2.859693295451294],
        &[147.12150275711716, -1.41221402718213, 71.68940251302358],
        &[165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306],
        &[24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471],
        &[
            30.91273214028599,
            -3.1208243349937974,
            77.79954646070892,
            34.28646028294783,
            -19.097331116725623,
            -28.087943162872662,
        ],
        &[
            37.80277123390563,
            -3.2571969029072276,
            112.26918849496327,
            66.9347231244047,
            -40.06618937091002,
            -54.66780262877968,
            -9.48861652309627,
        ],
    ],
    c: &[0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0],
    d: &[
        0.21193756319429014,
        -0.42387512638858027,
        -0.3384627126235924,
        1.8046452872882734,
        2.325825639765069,
        0.0,
        0.0,
        0.0,
    ],
    h: &[
        &[
            25.948786856663858,
            -2.5579724845846235,
            10.433815404888879,
            -2.3679251022685204,
            0.524948541321073,
            1.1241088310450404,
            0.4272876194431874,
            -0.17202221070155493,
        ],
        &[
            -9.91568850695171,
            -0.9689944594115154,
            3.0438037242978453,
            -24.495224566215796,
            20.176138334709044,
            15.98066361424651,
            -6.789040303419874,
            -6.710236069923372,
        ],
        &[
            11.419903575922262,
            2.8879645146136994,
            72.92137995996029,
            80.12511834622643,
            -52.072871366152654,
            -59.78993625266729,
            -0.15582684282751913,
            4.883087185713722,
        ],
    ],
};

#[cfg(test)]
mod tests {
    use super::*;

    type Matrix = Vec<Vec<f64>>;

    fn lower(rows: &[&[f64]], n: usize) -> Matrix {
        let mut full = vec![vec![0.0; n]; n];
        for (i, row) in rows.iter().enumerate() {
            full[i + 1][..row.len()].copy_from_slice(row);
        }
        full
    }
    fn times(a: &Matrix, b: &Matrix) -> Matrix {
        let n = a.len();
        let entry = |i: usize, j: usize| (0..n).map(|k| a[i][k] * b[k][j]).sum();
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }
    /// α, β = α + Γ and b of the textbook's form: Γ = (I/γ − C)⁻¹, α = a Γ, b = m Γ.
    fn textbook(t: &RosenbrockTableau) -> (Matrix, Matrix, Vec<f64>) {
        let n = t.c.len();
        let c = lower(t.c_matrix, n);
        let mut gamma = vec![vec![0.0; n]; n];
        for j in 0..n {
            for i in j..n {
                let known: f64 = (j..i).map(|k| c[i][k] * gamma[k][j]).sum();
                gamma[i][j] = t.gamma * (known + if i == j { 1.0 } else { 0.0 });
            }
        }
        let a = lower(t.a, n);
        // The end point is the last stage's argument plus the last stage.
        let mut m = a[n - 1].clone();
        m[n - 1] = 1.0;
        let b = (0..n).map(|j| (0..n).map(|k| m[k] * gamma[k][j]).sum()).collect();
        let alpha = times(&a, &gamma);
        let beta = (0..n).map(|i| (0..n).map(|j| alpha[i][j] + gamma[i][j]).collect()).collect();
        (alpha, beta, b)
    }

    /// All conditions of Rosenbrock methods up to order 5 (Hairer, Wanner, IV.7, Table 7.1).
    #[test]
    fn order_conditions_hold_to_rounding() {
        for t in [RODAS4, RODAS5P] {
            let (alpha, beta, b) = textbook(&t);
            let n = b.len();
            let sum = |m: &Matrix| -> Vec<f64> { m.iter().map(|r| r.iter().sum()).collect() };
            let of = |m: &Matrix, x: &[f64]| -> Vec<f64> {
                m.iter().map(|r| r.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
            };
            let (al, be) = (sum(&alpha), sum(&beta));
            let power = |k: i32| al.iter().map(|x| x.powi(k)).collect::<Vec<f64>>();
            let mul = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(a, b)| a * b).collect::<Vec<f64>>();
            for i in 0..n {
                let gamma_row = be[i] - al[i];
                assert!((al[i] - t.c[i]).abs() < 1e-12 && (gamma_row - t.d[i]).abs() < 1e-12, "row {i}");
            }
            let one = vec![1.0; n];
            let conditions: Vec<(u32, Vec<f64>, f64)> = vec![
                (1, one, 1.0),
                (2, be.clone(), 2.0),
                (3, power(2), 3.0),
                (3, of(&beta, &be), 6.0),
                (4, power(3), 4.0),
                (4, mul(&al, &of(&alpha, &be)), 8.0),
                (4, of(&beta, &power(2)), 12.0),
                (4, of(&beta, &of(&beta, &be)), 24.0),
                (5, power(4), 5.0),
                (5, mul(&power(2), &of(&alpha, &be)), 10.0),
                (5, mul(&of(&alpha, &be), &of(&alpha, &be)), 20.0),
                (5, mul(&al, &of(&alpha, &power(2))), 15.0),
                (5, mul(&al, &of(&alpha, &of(&beta, &be))), 30.0),
                (5, of(&beta, &power(3)), 20.0),
                (5, of(&beta, &mul(&al, &of(&alpha, &be))), 40.0),
                (5, of(&beta, &of(&beta, &power(2))), 60.0),
                (5, of(&beta, &of(&beta, &of(&beta, &be))), 120.0),
            ];
            for (i, (order, phi, density)) in conditions.iter().enumerate() {
                let value: f64 = b.iter().zip(phi).map(|(b, p)| b * p).sum();
                let error = (value - 1.0 / density).abs();
                if *order <= t.order {
                    // Weights reach 165 and have 16 digits: products of four of them are good to some 1e-12.
                    assert!(error < 1e-11, "condition {i} of order {order}: {error:e}");
                }
            }
            // Not all conditions of order 5 hold for a method of order 4.
            let all = conditions.iter().all(|(_, phi, density)| {
                let value: f64 = b.iter().zip(phi).map(|(b, p)| b * p).sum();
                (value - 1.0 / density).abs() < 1e-6
            });
            assert_eq!(all, t.order == 5);
        }
    }
}
