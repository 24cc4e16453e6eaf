//! A row of the page: a statement, our expression, and two evaluations that are compared.

use crate::papers::scene::Scene;
use nalgebra::DMatrix;
use phipsi_spatial::{Dd, Real};
use phipsi_topology::Operator;

/// Where a statement holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Chains, trees and forests.
    Trees,
    /// Chains only: on a tree that branches on two levels it must fail.
    Chains,
    /// One tree on a free base.
    Free,
}

/// One side of a statement.
#[derive(Clone)]
pub enum Form<T> {
    /// An expression, evaluated as sweeps.
    Expression(Operator<T>),
    /// Numbers.
    Matrix(DMatrix<T>),
}

impl<T: Real> Form<T> {
    pub fn dense(&self) -> DMatrix<T> {
        match self {
            Form::Expression(a) => a.dense().unwrap_or_else(|error| panic!("{error}")),
            Form::Matrix(a) => a.clone(),
        }
    }
}

impl<T> From<Operator<T>> for Form<T> {
    fn from(a: Operator<T>) -> Self {
        Form::Expression(a)
    }
}
impl<T: Real> From<&Operator<T>> for Form<T> {
    fn from(a: &Operator<T>) -> Self {
        Form::Expression(a.clone())
    }
}
impl<T> From<DMatrix<T>> for Form<T> {
    fn from(a: DMatrix<T>) -> Self {
        Form::Matrix(a)
    }
}
impl<T: Real> From<Vec<T>> for Form<T> {
    fn from(x: Vec<T>) -> Self {
        Form::Matrix(DMatrix::from_column_slice(x.len(), 1, &x))
    }
}
impl<T: Real> From<T> for Form<T> {
    fn from(x: T) -> Self {
        Form::from(vec![x])
    }
}

/// left = right, with what its terms are as large as where they cancel.
pub struct Part<T> {
    pub left: Form<T>,
    pub right: Form<T>,
    pub scale: Option<Form<T>>,
}

/// The equations of a row; none if the scene does not serve it.
pub struct Equations<T> {
    pub parts: Vec<Part<T>>,
    /// What is printed, where that is wrong: the two sides must differ.
    pub printed: Option<(Form<T>, Form<T>)>,
}

pub fn eq<T>(left: impl Into<Form<T>>, right: impl Into<Form<T>>) -> Equations<T> {
    none().and(left, right)
}

pub fn none<T>() -> Equations<T> {
    Equations { parts: vec![], printed: None }
}

impl<T> Equations<T> {
    pub fn and(mut self, left: impl Into<Form<T>>, right: impl Into<Form<T>>) -> Self {
        self.parts.push(Part { left: left.into(), right: right.into(), scale: None });
        self
    }
    /// The last equation's terms are as large as this and cancel.
    pub fn of(mut self, scale: impl Into<Form<T>>) -> Self {
        self.parts.last_mut().expect("an equation").scale = Some(scale.into());
        self
    }
    pub fn printed(mut self, left: impl Into<Form<T>>, right: impl Into<Form<T>>) -> Self {
        self.printed = Some((left.into(), right.into()));
        self
    }
}

/// A line of the page with its check.
pub struct Row {
    /// Paper and number.
    pub number: &'static str,
    /// The statement, as corrected.
    pub statement: &'static str,
    /// What the print has wrong; empty if nothing.
    pub print: &'static str,
    /// Functions and fields of the library.
    pub functions: &'static str,
    pub domain: Domain,
    pub plain: fn(&Scene<f64>) -> Equations<f64>,
    pub wide: fn(&Scene<Dd>) -> Equations<Dd>,
}

/// A row whose check is written once for both numbers.
#[macro_export]
macro_rules! row {
    ($number:literal, $statement:literal, $print:literal, $functions:literal, $domain:ident, |$s:ident| $body:expr) => {
        $crate::papers::row::Row {
            number: $number,
            statement: $statement,
            print: $print,
            functions: $functions,
            domain: $crate::papers::row::Domain::$domain,
            plain: |$s| $body,
            wide: |$s| $body,
        }
    };
}

/// A*.
pub fn t<T: Real>(a: &Operator<T>) -> Operator<T> {
    a.adjoint()
}

/// A product of operators.
#[macro_export]
macro_rules! mul {
    ($a:expr $(, $b:expr)+) => { $a.clone() $(* $b.clone())+ };
}
