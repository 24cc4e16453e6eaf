//! Systems of OpenMM: every force, every kind of mistake, and files broken at random.

mod mutation;

use phipsi_formats::report::{Loaded, Note, Report};
use phipsi_formats::system::*;

/// Every force and every element.
const ALL: &str = include_str!("system/all_forces.xml");

fn read(text: &str) -> Loaded<System> {
    read_system(text, "test.xml", &SystemOptions::default())
}

fn accept(text: &str) -> (System, Report) {
    read(text).into_result(true).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn everything_arrives() {
    let (system, report) = accept(ALL);
    assert_eq!(system.masses, [12.0, 1.0, 14.5, 0.0]);
    assert_eq!(system.constraints, [Constraint { atoms: [1, 0], distance: 0.101 }]);
    let names: Vec<&str> = system.forces.iter().map(|force| force.name.as_str()).collect();
    let classes: Vec<&str> = system.forces.iter().map(|force| force.class.as_str()).collect();
    assert_eq!((names[0], classes[0], system.forces[0].group), ("springs", "HarmonicBondForce", 3));
    // A force without a name is called by its class.
    assert_eq!(names[1..], classes[1..]);
    assert_eq!(system.forces[0].line, Some(14));
    assert_eq!(system.global_parameters.iter().collect::<Vec<_>>(), [(&"shift".to_string(), &1.5)]);
    let [bonds, angles, torsions, rb, cmap, nonbonded, gbsa, bond, angle, torsion, pairs, gb] =
        &system.forces[..]
    else {
        panic!("{names:?}")
    };
    let ForceKind::HarmonicBond(bonds) = &bonds.kind else { panic!() };
    assert_eq!(bonds[1], HarmonicBond { atoms: [2, 0], length: 0.12, stiffness: 3e5 });
    let ForceKind::HarmonicAngle(angles) = &angles.kind else { panic!() };
    assert_eq!(angles[..], [HarmonicAngle { atoms: [1, 0, 2], angle: 2.1, stiffness: 500.0 }]);
    let ForceKind::PeriodicTorsion(torsions) = &torsions.kind else { panic!() };
    let phase = std::f64::consts::PI;
    let expected = PeriodicTorsion { atoms: [0, 1, 2, 3], periodicity: 2, phase, stiffness: 10.46 };
    assert_eq!(torsions[..], [expected]);
    let ForceKind::RbTorsion(rb) = &rb.kind else { panic!() };
    assert_eq!(rb[0].coefficients, [1.0, 2.0, 3.0, 4.0, 5.0, -6.0]);
    let ForceKind::CmapTorsion(cmap) = &cmap.kind else { panic!() };
    assert_eq!(cmap.maps, [CmapMap { size: 2, energies: vec![1.0, 2.0, 3.0, 4.0] }]);
    assert_eq!(cmap.torsions, [CmapPair { map: 0, atoms: [[0, 1, 2, 3], [3, 2, 1, 0]] }]);
    let ForceKind::Nonbonded(nonbonded) = &nonbonded.kind else { panic!() };
    assert_eq!(nonbonded.particles[1], NonbondedParticle { charge: 0.11, sigma: 0.26, epsilon: 0.06 });
    let exception = NonbondedException { atoms: [2, 1], charge_product: -0.01, sigma: 0.3, epsilon: 0.5 };
    assert_eq!(nonbonded.exceptions[1], exception);
    let ForceKind::GbsaObc(gbsa) = &gbsa.kind else { panic!() };
    assert_eq!(gbsa.particles[2], GbsaParticle { charge: 0.25, radius: 0.155, scale: 0.79 });
    let constants = [gbsa.solute_dielectric, gbsa.solvent_dielectric, gbsa.surface_area_energy];
    assert_eq!(constants, [1.0, 78.5, 2.25936]);
    let ForceKind::CustomBond(bond) = &bond.kind else { panic!() };
    assert_eq!((&bond.atoms[..], &bond.parameters[..]), (&[[0, 3]][..], &[20.0, 0.2][..]));
    assert_eq!(bond.energy.value(&mut [0.5, 20.0, 0.25]), 2.75);
    let ForceKind::CustomAngle(angle) = &angle.kind else { panic!() };
    assert_eq!(
        (angle.atoms[0], angle.coordinate, &angle.parameter_names[..]),
        ([0, 3, 1], "theta", &["k".into()][..])
    );
    let ForceKind::CustomTorsion(torsion) = &torsion.kind else { panic!() };
    assert_eq!((torsion.atoms[0], torsion.parameters.len()), ([0, 3, 1, 2], 0));
    let ForceKind::CustomNonbonded(pairs) = &pairs.kind else { panic!() };
    assert_eq!((&pairs.parameters[..], &pairs.exclusions[..]), (&[0.0, 1.0, 0.0, 1.0][..], &[[3, 1]][..]));
    let mut buffer = vec![0.0; pairs.energy.slots()];
    buffer[..3].copy_from_slice(&[0.5, 1.0, 0.0]);
    assert_eq!(pairs.energy.value(&mut buffer), 1.0);
    let ForceKind::CustomGb(gb) = &gb.kind else { panic!() };
    let scopes: Vec<GbScope> =
        gb.values.iter().map(|v| v.scope).chain(gb.energies.iter().map(|e| e.scope)).collect();
    assert_eq!(scopes, [GbScope::PairWithExclusions, GbScope::Particle, GbScope::Particle, GbScope::Pair]);
    // r, then q, density and b of both particles.
    assert_eq!(gb.energies[1].formula.value(&mut [2.0, 3.0, 0.0, 5.0, 7.0, 11.0, 0.0]), 577.5);
    assert_eq!(report.ignored.len(), 3, "{report}");
    assert!(
        report.to_string().contains("force `MonteCarloBarostat`: MonteCarloBarostat, barostat"),
        "{report}"
    );
}

#[test]
fn a_file_written_by_openmm_7_is_read() {
    // Earlier versions write fewer attributes.
    let text = r#"<System openmmVersion="7.4" type="System" version="1">
      <PeriodicBoxVectors><A x="2" y="0" z="0"/><B x="0" y="2" z="0"/><C x="0" y="0" z="2"/></PeriodicBoxVectors>
      <Particles><Particle mass="12"/><Particle mass="1"/></Particles><Constraints/>
      <Forces>
        <Force type="HarmonicBondForce" version="1" forceGroup="0"><Bonds><Bond d="1.09e-1" k="284512" p1="0" p2="1"/></Bonds></Force>
        <Force type="GBSAOBCForce" version="1" method="0" cutoff="1" soluteDielectric="1" solventDielectric="78.3">
          <Particles><Particle q="0" r=".15" scale=".8"/><Particle q="0" r=".15" scale=".8"/></Particles></Force>
        <Force type="NonbondedForce" version="1" method="0" cutoff="1" ewaldTolerance=".0005" rfDielectric="78.3"
          dispersionCorrection="1"><Particles><Particle q="0" sig="1" eps="0"/><Particle q="0" sig="1" eps="0"/></Particles>
          <Exceptions/></Force>
      </Forces></System>"#;
    let (system, _) = accept(text);
    let ForceKind::GbsaObc(gbsa) = &system.forces[1].kind else { panic!() };
    assert_eq!(gbsa.surface_area_energy, 2.25936);
}

/// A mistake in [`ALL`]: what is replaced by what, and how it is reported.
type Case = ([&'static str; 2], u32, &'static str, &'static str, &'static str);

fn check(cases: &[Case]) {
    for ([from, to], line, place, found, remedy) in cases {
        assert_eq!(ALL.matches(from).count(), 1, "{from}");
        let read = read(&ALL.replace(from, to));
        assert!(read.value.is_none(), "{to}: {}", read.report);
        let [problem] = &read.report.errors[..] else { panic!("{to}: not one error:\n{}", read.report) };
        assert!(
            problem.line == Some(*line)
                && problem.place == *place
                && problem.found == *found
                && problem.remedy == *remedy,
            "{to}: {problem:#?}"
        );
        assert!(!problem.required.is_empty());
    }
}

#[test]
fn errors_have_force_entry_line_and_remedy() {
    let correct = "correct it, or serialize the system again";
    check(&[
        (["mass=\"14.5\"", "mass=\"nan\""], 7, "System, particle 2", "mass=\"nan\" in <Particle>", correct),
        (["mass=\"14.5\"", "mass=\"-1\""], 7, "System, particle 2", "mass=\"-1\" in <Particle>", correct),
        (
            ["mass=\"14.5\"", ""],
            7,
            "System, particle 2",
            "no attribute `mass` in <Particle>",
            "serialize the system again",
        ),
        (
            ["p1=\"1\" p2=\"0\"/>", "p1=\"1\" p2=\"4\"/>"],
            11,
            "System, constraint 0",
            "p2=\"4\" in <Constraint>",
            correct,
        ),
        (["k=\"284512\"", "k=\"1e999\""], 16, "force `springs`, bond 0", "k=\"1e999\" in <Bond>", correct),
        (
            ["k=\"3e5\" p1=\"2\"", "k=\"3e5\" p1=\"-1\""],
            17,
            "force `springs`, bond 1",
            "p1=\"-1\" in <Bond>",
            correct,
        ),
        (
            ["k=\"3e5\" p1=\"2\"", "k=\"3e5\" p1=\"0\""],
            17,
            "force `springs`, bond 1",
            "particle 0 twice in <Bond>",
            "remove this entry, or correct its particles",
        ),
        (
            ["a=\"2.1\"", "a=\"120\""],
            22,
            "force `HarmonicAngleForce`, angle 0",
            "a=\"120\" in <Angle>",
            correct,
        ),
        (
            ["periodicity=\"2\"", "periodicity=\"2.5\""],
            27,
            "force `PeriodicTorsionForce`, torsion 0",
            "periodicity=\"2.5\" in <Torsion>",
            correct,
        ),
        (["c5=\"-6\"", "c5=\"\""], 32, "force `RBTorsionForce`, torsion 0", "c5=\"\" in <Torsion>", correct),
        (
            ["<Map size=\"2\">", "<Map size=\"3\">"],
            37,
            "force `CMAPTorsionForce`, map 0",
            "size 3 and 4 energies",
            "serialize the system again",
        ),
        (
            ["map=\"0\"", "map=\"1\""],
            45,
            "force `CMAPTorsionForce`, torsion 0",
            "map=\"1\" in <Torsion>",
            correct,
        ),
        (
            ["<Exception eps=\".5\" p1=\"2\"", "<Exception eps=\".5\" p1=\"0\""],
            60,
            "force `NonbondedForce`, exception 1",
            "a second exception of particles 0 and 1",
            "remove it or exception 0",
        ),
        (
            ["eps=\".71\"", "eps=\"-1\""],
            55,
            "force `NonbondedForce`, particle 2",
            "eps=\"-1\" in <Particle>",
            correct,
        ),
        (
            ["<Particle eps=\"0\" q=\"0\" sig=\"1\"/>", ""],
            48,
            "force `NonbondedForce`",
            "parameters of 3 particles",
            "call force.addParticle(…) once for each",
        ),
        (
            ["r=\".155\"", "r=\".009\""],
            67,
            "force `GBSAOBCForce`, particle 2",
            "r=\"0.009\" in <Particle>",
            correct,
        ),
        (
            ["k*(r-r0)^2 + shift", "k*(r-r0)^2 + shft"],
            71,
            "force `CustomBondForce`",
            "unknown name \"shft\" at character 14 of energy=\"k*(r-r0)^2 + shft\"",
            "did you mean `shift`?",
        ),
        (
            ["<Parameter name=\"r0\"/>", "<Parameter name=\"r\"/>"],
            74,
            "force `CustomBondForce`, parameter 1",
            "name=\"r\" in <Parameter>",
            correct,
        ),
        (
            ["<Value v=\"3\"/>", ""],
            121,
            "force `CustomNonbondedForce`, function 0",
            "3 values",
            "correct the function",
        ),
        (
            ["type=\"Continuous1DFunction\"", "type=\"Continuous2DFunction\""],
            129,
            "force `CustomNonbondedForce`, function 1",
            "type=\"Continuous2DFunction\" in <Function>",
            correct,
        ),
        (
            ["curve(r)\"", "curve(r, 2)\""],
            104,
            "force `CustomNonbondedForce`",
            "curve with 2 arguments at character 20 of energy=\"pair(type1, type2)*curve(r, 2)\"",
            "give 1 arguments",
        ),
        (
            ["name=\"density\" type=\"1\"", "name=\"density\" type=\"0\""],
            148,
            "force `CustomGBForce`, computed value 0",
            "the first computed value of a single particle",
            "OpenMM has the same rule: rewrite it",
        ),
        (
            ["q1*q2*b1*density2/r", "q1*q2*b1*dense2/r"],
            153,
            "force `CustomGBForce`, energy term 1",
            "unknown name \"dense2\" at character 10 of expression=\"q1*q2*b1*dense2/r\"",
            "correct it, or define it: …; dense2 = …",
        ),
    ]);
    // One parameter has one value.
    let second = ALL.rfind("default=\"1.5\"").unwrap();
    let text = format!("{}default=\"2\"{}", &ALL[..second], &ALL[second + 13..]);
    let report = read(&text).report;
    assert_eq!(
        (report.errors[0].line, report.errors[0].required.as_str()),
        (Some(144), "1.5, as in a force before")
    );
}

#[test]
fn what_phipsi_does_not_have_is_refused_by_name() {
    let make =
        "make the system by forcefield.createSystem(topology, nonbondedMethod=NoCutoff, constraints=None)";
    check(&[
        (
            ["ljnz=\"0\" method=\"0\"", "ljnz=\"0\" method=\"4\""],
            48,
            "force `NonbondedForce`",
            "method 4 (PME)",
            make,
        ),
        (
            [
                "forceGroup=\"0\" method=\"0\" name=\"CustomNonbondedForce\"",
                "method=\"2\" name=\"CustomNonbondedForce\"",
            ],
            104,
            "force `CustomNonbondedForce`",
            "method 2 (CutoffPeriodic)",
            make,
        ),
        (
            ["type=\"RBTorsionForce\" usesPeriodic=\"0\"", "type=\"RBTorsionForce\" usesPeriodic=\"1\""],
            30,
            "force `RBTorsionForce`",
            "a periodic box in use",
            "force.setUsesPeriodicBoundaryConditions(False) in OpenMM",
        ),
        (
            [
                "<Particle mass=\"0\"/>",
                "<Particle mass=\"0\"><TwoParticleAverageSite p1=\"0\" p2=\"1\" w1=\".5\" w2=\".5\"/></Particle>",
            ],
            8,
            "System, particle 3",
            "a virtual site (TwoParticleAverageSite)",
            "use a model without virtual sites, such as tip3p instead of tip4pew for water",
        ),
        (
            [
                "<ParticleOffsets/>",
                "<ParticleOffsets><Offset particle=\"0\" parameter=\"l\" q=\"1\" sig=\"0\" eps=\"0\"/></ParticleOffsets>",
            ],
            50,
            "force `NonbondedForce`",
            "a parameter offset",
            "set the parameters themselves: force.setParticleParameters(…)",
        ),
        (
            ["<InteractionGroups/>", "<InteractionGroups><InteractionGroup/></InteractionGroups>"],
            137,
            "force `CustomNonbondedForce`",
            "an interaction group",
            "write the energy by parameters of the particles",
        ),
        (
            [
                "name=\"CMMotionRemover\" type=\"CMMotionRemover\"",
                "name=\"pull\" type=\"CustomExternalForce\"",
            ],
            166,
            "force `pull`",
            "class \"CustomExternalForce\"",
            "leave it out of the system (system.removeForce(index)), or ignore it by its name; make the rest by \
             forcefield.createSystem(topology, nonbondedMethod=NoCutoff, constraints=None)",
        ),
    ]);
    let pull = ALL.replace(
        "name=\"CMMotionRemover\" type=\"CMMotionRemover\"",
        "name=\"pull\" type=\"CustomExternalForce\"",
    );
    for word in ["pull", "CustomExternalForce"] {
        let options = SystemOptions { ignore: vec![word.into()] };
        let (_, report) = read_system(&pull, "test.xml", &options).into_result(true).unwrap();
        assert!(report.to_string().contains("force `pull`: CustomExternalForce, as asked for"), "{report}");
    }
    let root = read("<ForceField/>").report.errors.remove(0);
    assert_eq!(
        root.remedy,
        "this is a force field: give the system that forcefield.createSystem(…) makes of it"
    );
    let empty = read("<System><Particles/><Forces/></System>").report.errors.remove(0);
    assert_eq!(empty.found, "no particles");
    let missing = read_system_file("no such file.xml", &SystemOptions::default()).report;
    assert_eq!((missing.errors.len(), missing.errors[0].place.as_str()), (1, "file"));
}

#[test]
fn unknown_attributes_and_elements_are_warnings() {
    for (from, to, found, remedy) in [
        ("d=\".12\"", "d=\".12\" kk=\"1\"", "unknown attribute \"kk\" of <Bond>", "did you mean `k`?"),
        (
            "param1=\"20\"",
            "param1=\"20\" param3=\"1\"",
            "unknown attribute \"param3\" of <Bond>",
            "did you mean `param1`?",
        ),
        ("<Exceptions>", "<Extras/><Exceptions>", "unknown element \"Extras\" in <Force>", ""),
    ] {
        let read = read(&ALL.replace(from, to));
        assert!(read.value.is_some(), "{}", read.report);
        let [warning] = &read.report.warnings[..] else { panic!("{}", read.report) };
        assert_eq!(warning.found, found);
        assert!(remedy.is_empty() || warning.remedy == remedy, "{warning:?}");
    }
}

#[test]
fn many_errors_are_not_all_listed() {
    let bonds = "<Bond d=\"x\" k=\"y\" p1=\"9\" p2=\"9\"/>".repeat(5000);
    let read =
        read(&ALL.replace("<Bonds>\n\t\t\t\t<Bond d=\".109\"", &format!("<Bonds>{bonds}<Bond d=\".109\"")));
    assert!(read.value.is_none());
    assert_eq!(read.report.errors.len(), 1001);
    assert!(read.report.errors[1000].found.contains("more than 1000 errors"));
}

#[test]
fn a_periodic_box_is_read_where_nonbonded_force_uses_it() {
    let periodic = ALL
        .replace("ljnz=\"0\" method=\"0\"", "ljnz=\"0\" method=\"2\"")
        .replace("exceptionsUsePeriodic=\"0\"", "exceptionsUsePeriodic=\"1\"");
    let (system, report) = accept(&periodic);
    let box_vectors = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
    assert_eq!(system.box_vectors, Some(box_vectors));
    let tables = system.forces.iter().find_map(|force| match &force.kind {
        ForceKind::Nonbonded(tables) => Some(tables),
        _ => None,
    });
    let tables = tables.unwrap();
    let expected = Periodic { box_vectors, exceptions: true, dispersion_correction: true };
    assert_eq!((tables.periodic, tables.cutoff.map(|c| c.distance)), (Some(expected), Some(1.0)));
    assert!(report.approximated.iter().any(|note| note.what.contains("nearest images")));
    // What the box must be is asked only where a force uses it.
    let a = "<A x=\"2\" y=\"0\" z=\"0\"/>";
    for (to, found) in [
        ("<A x=\"2\" y=\"0\" z=\"nan\"/>", "without periodic box vectors"),
        ("<A x=\"2\" y=\"0.1\" z=\"0\"/>", "periodic box vectors [2.0, 0.1, 0.0]"),
        ("<A x=\"-2\" y=\"0\" z=\"0\"/>", "periodic box vectors [-2.0"),
        ("<A x=\"1.9\" y=\"0\" z=\"0\"/>", "a cutoff of 1 nm in a box of 1.9, 2, 2 nm"),
    ] {
        assert!(read(&ALL.replace(a, to)).value.is_some(), "{to}");
        let refused = read(&periodic.replace(a, to));
        let [problem] = &refused.report.errors[..] else { panic!("{to}: {}", refused.report) };
        assert!(refused.value.is_none() && problem.found.contains(found), "{problem:?}");
        assert_eq!(problem.place, "force `NonbondedForce`");
    }
}

#[test]
fn cutoffs_are_read() {
    let text = ALL
        .replace("ljnz=\"0\" method=\"0\"", "ljnz=\"0\" method=\"1\"")
        .replace(
            "rfDielectric=\"1\" switchingDistance=\"-1\"",
            "rfDielectric=\"78.3\" switchingDistance=\".75\"",
        )
        .replace(
            "type=\"NonbondedForce\" useSwitchingFunction=\"0\"",
            "type=\"NonbondedForce\" useSwitchingFunction=\"1\"",
        )
        .replace("forceGroup=\"0\" method=\"0\" name=\"GBSAOBCForce\"", "method=\"1\" name=\"GBSAOBCForce\"")
        .replace("forceGroup=\"0\" method=\"0\" name=\"Custom", "method=\"1\" name=\"Custom");
    let (system, report) = accept(&text);
    let told = |note: &&Note| note.what == "pairs from 1 nm on are left out";
    assert_eq!(report.approximated.iter().filter(told).count(), 4);
    let mut found = 0;
    for force in &system.forces {
        found += match &force.kind {
            ForceKind::Nonbonded(force) => {
                assert_eq!(force.cutoff, Some(Cutoff { distance: 1.0, switching: Some(0.75) }));
                assert_eq!(force.reaction_field_dielectric, 78.3);
                1
            }
            ForceKind::GbsaObc(force) => {
                assert_eq!(force.cutoff, Some(1.0));
                1
            }
            ForceKind::CustomNonbonded(force) => {
                assert_eq!(force.cutoff, Some(Cutoff { distance: 1.0, switching: None }));
                1
            }
            ForceKind::CustomGb(force) => {
                assert_eq!(force.cutoff, Some(1.0));
                1
            }
            _ => 0,
        };
    }
    assert_eq!(found, 4);
    for (from, to, place) in [
        ("cutoff=\"1\" dispersion", "cutoff=\"0\" dispersion", "cutoff=\"0\" in <Force>"),
        ("switchingDistance=\".75\"", "switchingDistance=\"1\"", "switchingDistance=\"1\" in <Force>"),
        ("rfDielectric=\"78.3\"", "rfDielectric=\"-1\"", "rfDielectric=\"-1\" in <Force>"),
    ] {
        assert!(text.contains(from), "{from}");
        let report = read(&text.replace(from, to)).report;
        assert_eq!(report.errors.len(), 1, "{report}");
        assert_eq!(report.errors[0].found, place);
    }
}
