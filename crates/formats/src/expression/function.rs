//! The functions of expressions: names, numbers of arguments, values.

/// A function of one argument. Square, cube and reciprocal also stand for powers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Unary {
    Negate,
    Sqrt,
    Exp,
    Log,
    Sin,
    Cos,
    Tan,
    Sec,
    Csc,
    Cot,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Erf,
    Erfc,
    Step,
    Delta,
    Square,
    Cube,
    Recip,
    Abs,
    Floor,
    Ceil,
}

/// A function of two arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Atan2,
    Min,
    Max,
}

/// A function by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    One(Unary),
    Two(Binary),
    Select,
}

/// The functions that can be called.
pub(super) const FUNCTIONS: [(&str, Function); 29] = [
    ("sqrt", Function::One(Unary::Sqrt)),
    ("exp", Function::One(Unary::Exp)),
    ("log", Function::One(Unary::Log)),
    ("sin", Function::One(Unary::Sin)),
    ("cos", Function::One(Unary::Cos)),
    ("tan", Function::One(Unary::Tan)),
    ("sec", Function::One(Unary::Sec)),
    ("csc", Function::One(Unary::Csc)),
    ("cot", Function::One(Unary::Cot)),
    ("asin", Function::One(Unary::Asin)),
    ("acos", Function::One(Unary::Acos)),
    ("atan", Function::One(Unary::Atan)),
    ("atan2", Function::Two(Binary::Atan2)),
    ("sinh", Function::One(Unary::Sinh)),
    ("cosh", Function::One(Unary::Cosh)),
    ("tanh", Function::One(Unary::Tanh)),
    ("erf", Function::One(Unary::Erf)),
    ("erfc", Function::One(Unary::Erfc)),
    ("step", Function::One(Unary::Step)),
    ("delta", Function::One(Unary::Delta)),
    ("square", Function::One(Unary::Square)),
    ("cube", Function::One(Unary::Cube)),
    ("recip", Function::One(Unary::Recip)),
    ("min", Function::Two(Binary::Min)),
    ("max", Function::Two(Binary::Max)),
    ("abs", Function::One(Unary::Abs)),
    ("floor", Function::One(Unary::Floor)),
    ("ceil", Function::One(Unary::Ceil)),
    ("select", Function::Select),
];

/// Words of other programs for the same functions.
pub(super) const SYNONYMS: [(&str, &str); 13] = [
    ("ln", "log"),
    ("arcsin", "asin"),
    ("arccos", "acos"),
    ("arctan", "atan"),
    ("arctan2", "atan2"),
    ("fabs", "abs"),
    ("heaviside", "step"),
    ("if", "select"),
    ("where", "select"),
    ("sign", "2*step(x)-1"),
    ("pow", "x^y"),
    ("log10", "log(x)/log(10)"),
    ("log2", "log(x)/log(2)"),
];

impl Function {
    pub(super) fn arguments(self) -> usize {
        match self {
            Function::One(_) => 1,
            Function::Two(_) => 2,
            Function::Select => 3,
        }
    }
}

/// Name of a function that is written as a call.
fn name(function: Function) -> &'static str {
    FUNCTIONS.iter().find(|(_, f)| *f == function).map_or("", |(name, _)| name)
}

impl Unary {
    pub(super) fn name(self) -> &'static str {
        name(Function::One(self))
    }
    #[inline]
    pub(super) fn value(self, x: f64) -> f64 {
        match self {
            Unary::Negate => -x,
            Unary::Sqrt => x.sqrt(),
            Unary::Exp => x.exp(),
            Unary::Log => x.ln(),
            Unary::Sin => x.sin(),
            Unary::Cos => x.cos(),
            Unary::Tan => x.tan(),
            Unary::Sec => 1.0 / x.cos(),
            Unary::Csc => 1.0 / x.sin(),
            Unary::Cot => 1.0 / x.tan(),
            Unary::Asin => x.asin(),
            Unary::Acos => x.acos(),
            Unary::Atan => x.atan(),
            Unary::Sinh => x.sinh(),
            Unary::Cosh => x.cosh(),
            Unary::Tanh => x.tanh(),
            Unary::Erf => libm::erf(x),
            Unary::Erfc => libm::erfc(x),
            // Comparisons with NaN are false; it must not come out as a number.
            Unary::Step => truth(x >= 0.0, x),
            Unary::Delta => truth(x == 0.0, x),
            Unary::Square => x * x,
            Unary::Cube => x * x * x,
            Unary::Recip => 1.0 / x,
            Unary::Abs => x.abs(),
            Unary::Floor => x.floor(),
            Unary::Ceil => x.ceil(),
        }
    }
}

fn truth(holds: bool, x: f64) -> f64 {
    match (holds, x.is_nan()) {
        (_, true) => f64::NAN,
        (true, _) => 1.0,
        (false, _) => 0.0,
    }
}

impl Binary {
    pub(super) fn name(self) -> &'static str {
        name(Function::Two(self))
    }
    #[inline]
    pub(super) fn value(self, x: f64, y: f64) -> f64 {
        match self {
            Binary::Add => x + y,
            Binary::Subtract => x - y,
            Binary::Multiply => x * y,
            Binary::Divide => x / y,
            Binary::Power => x.powf(y),
            Binary::Atan2 => x.atan2(y),
            // Unlike f64::min and max, a NaN on either side is the answer.
            Binary::Min if x.is_nan() || y.is_nan() => f64::NAN,
            Binary::Max if x.is_nan() || y.is_nan() => f64::NAN,
            Binary::Min => x.min(y),
            Binary::Max => x.max(y),
        }
    }
}

/// y if c is not zero, otherwise z.
#[inline]
pub(super) fn select(c: f64, y: f64, z: f64) -> f64 {
    if c.is_nan() {
        f64::NAN
    } else if c != 0.0 {
        y
    } else {
        z
    }
}

/// xⁿ by repeated squaring: at most 2 log₂|n| roundings of relative size n ε in all.
#[inline]
pub(super) fn integer_power(x: f64, n: i32) -> f64 {
    let (mut result, mut square, mut left) = (1.0, x, n.unsigned_abs());
    while left > 0 {
        if left & 1 == 1 {
            result *= square;
        }
        square *= square;
        left >>= 1;
    }
    if n < 0 { 1.0 / result } else { result }
}
